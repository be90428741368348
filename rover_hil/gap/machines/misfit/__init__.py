"""Is there a gap, how large is it, and where?"""
