"""Speed and endurance of the program and its drivers."""
