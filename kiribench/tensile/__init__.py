"""Camera frames and load data of a stretched sample to strain and Poisson curves."""
