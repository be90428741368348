"""The Robotino: its simulator, slip maps and motors against measured runs."""
