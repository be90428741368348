"""Prints where the rover is: `rover-hil run robotino --virtual --realtime --odometry-to localhost:5005`."""

import json
import socket

line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", 5005))
while True:
    pose = json.loads(line.recv(65536))["odometry"]
    if pose is not None:
        print(f"x {pose['x_m']:.3f} m, y {pose['y_m']:.3f} m, yaw {pose['yaw_rad']:.3f} rad, {pose['mode']}")
