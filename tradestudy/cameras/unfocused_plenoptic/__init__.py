"""An unfocused plenoptic camera (plenoptic I): the main image on the microlenses, the pupil under each of them."""
