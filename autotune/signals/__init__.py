"""Excitation, filters, spectra."""
