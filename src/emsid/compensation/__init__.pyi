from .inverse import Compensation as Compensation
from .inverse import compensate as compensate
from .map_inverse import MapInverse as MapInverse
from .torque_ripple import RippleCompensation as RippleCompensation
