"""VectorNav inertial sensors (VN-100, VN-200, VN-300) with asynchronous ASCII output."""
