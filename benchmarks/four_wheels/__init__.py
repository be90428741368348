"""The rover with four wheels: the field tests of the sComp paper, and its loop with the camera."""
