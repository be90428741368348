"""Speed and endurance figures, each as a ratio against a named peer; not part of the tests."""
