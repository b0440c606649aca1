"""A first look at a file: its columns, guesses of input, output and time, and the quality of the data."""

from emsid.first_look.advice import advice, opposite_signs
from emsid.first_look.clock import Clock
from emsid.first_look.columns import Code, Column, Stretch
from emsid.first_look.dynamics import Response, response
from emsid.first_look.look import FirstLook, describe
from emsid.first_look.names import ColumnQuantity, Meaning, meaning
from emsid.first_look.roles import Roles
from emsid.first_look.together import Group, describe_files, groups, without_findings_of_all

__all__ = [
    "Clock",
    "Code",
    "Column",
    "ColumnQuantity",
    "FirstLook",
    "Group",
    "Meaning",
    "Response",
    "Roles",
    "Stretch",
    "advice",
    "describe",
    "describe_files",
    "groups",
    "meaning",
    "opposite_signs",
    "response",
    "without_findings_of_all",
]
