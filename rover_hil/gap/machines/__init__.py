"""The workflow for machines that move: models made of equations with named ports."""
