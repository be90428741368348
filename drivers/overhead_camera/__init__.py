"""An overhead camera that sees the rover's marker: position and heading on the floor."""
