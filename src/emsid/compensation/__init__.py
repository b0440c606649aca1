"""Compensation: the inverses of what a model knows, to be put before the plant."""

from emsid.compensation.inverse import Compensation as Compensation
from emsid.compensation.inverse import compensate as compensate
from emsid.compensation.map_inverse import MapInverse as MapInverse
