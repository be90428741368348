"""What odometry, slip estimator and covariance are worth on a ground, by positions measured by hand."""
