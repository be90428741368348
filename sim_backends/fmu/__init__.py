"""Functional mock-up units (FMI 2 and 3, co-simulation) as models of machines."""
