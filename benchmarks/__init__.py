"""Measurements that need the source tree; `mjsheaf bench` finds them here."""
