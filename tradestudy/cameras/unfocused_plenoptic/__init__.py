"""An unfocused plenoptic camera (plenoptic I): the main lens's image on the microlenses, its pupil under each."""
