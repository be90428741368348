"""Run a rover: composition, cyclic executive, watchdog and replay."""
