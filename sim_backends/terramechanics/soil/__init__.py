"""Laws of wheel and soil."""
