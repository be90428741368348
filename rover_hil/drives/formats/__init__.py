"""Files of other programs become logs of this software."""
