"""Machines, rovers and hidden effects, written from the user's documents of `rover-hil gap` alone.

Nothing here imports the program or knows how it searches: numpy and scipy only.
"""
