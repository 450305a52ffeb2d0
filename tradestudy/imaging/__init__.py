"""How precisely a matcher measures disparity in a camera's picture, from transfer functions, noise and light."""
