"""What the user starts: configuration, loop, recording and replay, reports, command line.

Importing this package imports none of its parts, so that `import rover_hil` stays cheap.
"""
