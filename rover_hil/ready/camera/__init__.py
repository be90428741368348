"""Make the rig file of a rearward camera: lens, and pose above the ground."""
