"""Machines as nature makes them, with physical effects hidden in them; see README.md."""

from tests.nature.machines.case import Case, Run, Term
from tests.nature.machines.make import FAMILIES, make_case

__all__ = ["FAMILIES", "Case", "Run", "Term", "make_case"]
