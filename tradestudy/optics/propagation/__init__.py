"""Light behind one aperture: geometric, boundary wave, Fresnel, Kirchhoff, each with an error bar."""
