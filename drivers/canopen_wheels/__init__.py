"""CANopen drives with the profile CiA 402, one for each wheel."""
