"""Reports: one style, one page, and result files written whole or not at all."""
