"""Pictures of boards, of the free and the loaded antenna → lens, plane C, antenna and sensor, with their covariance."""
