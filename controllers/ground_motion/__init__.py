"""How the ground moves under a camera: travel that is measured, not inferred from wheels."""
