"""What is learnt from tables: calibration, statistics, surrogate, uncertainty."""
