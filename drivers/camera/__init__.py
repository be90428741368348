"""A camera: V4L2 device, folder of frames or video file."""
