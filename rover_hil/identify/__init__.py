"""Fit models of motors and slip to recorded runs."""
