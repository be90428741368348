"""Input-output board of Robotino 1, 2 and XT (EA05, EA09) on its serial port."""
