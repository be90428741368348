"""What an analysis writes: verdict, model file and report."""
