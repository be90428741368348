"""Machines described by a right-hand side with named ports: integration, sensitivities, standard effects."""
