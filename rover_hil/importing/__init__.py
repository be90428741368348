"""Reading measurements that others have recorded."""
