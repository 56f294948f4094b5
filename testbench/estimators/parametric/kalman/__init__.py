"""Kalman filters on a model structure: steady-state gain for filter error, EKF and UKF for states and parameters."""
