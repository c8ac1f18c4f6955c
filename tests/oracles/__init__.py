"""Independent ways to the answers that tests compare with."""
