"""The wheel's rut in the rear camera's frames."""
