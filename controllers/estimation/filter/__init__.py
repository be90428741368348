"""The pose filter: state, transition, measurements, and added uncertainty."""
