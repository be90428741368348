"""Report and files of an analysis of a machine."""
