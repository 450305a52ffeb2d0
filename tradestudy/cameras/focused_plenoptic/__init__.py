"""A focused plenoptic camera (plenoptic II): microlenses relay the image of the main lens onto the sensor."""
