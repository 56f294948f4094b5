"""What the residuals show: which data agree, where simulation and measurement part, what the air did."""
