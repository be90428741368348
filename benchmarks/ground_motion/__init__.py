"""Motion of the ground measured by a camera: accuracy, validity and cost."""
