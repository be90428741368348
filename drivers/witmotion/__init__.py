"""WitMotion inertial sensors with the 0x55 binary protocol."""
