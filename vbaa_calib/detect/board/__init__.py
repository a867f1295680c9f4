"""ChArUco corners and their covariance."""
