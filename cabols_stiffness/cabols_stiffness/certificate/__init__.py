"""Uncertainty budget, measured compliance, and the certificate that holds them."""
