"""`rover-hil ground`: motion over the ground of a folder of pictures, a video or a log."""
