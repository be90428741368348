"""The check manoeuvre: a short motion before the mission that shows whether the sources agree."""
