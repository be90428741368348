"""Recorded drives with one fault each, and drives without: inputs and right answers for an import.

An independent generator: own kinematics and noise, nothing of the program.
"""
