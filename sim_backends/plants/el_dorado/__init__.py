"""The four-wheel rover El-Dorado on sand: wheel-soil forces in a table, a body on four contacts."""
