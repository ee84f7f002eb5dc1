"""Paths of cars among obstacles, as initial guesses: hybrid A* with Reeds-Shepp paths; parking cases from files."""

from .car_kinematics import Trailer
from .car_path import CarPath, CarTiming
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CarSearch
from .parking_case import ParkingCar, ParkingCase
from .staged_search import staged_search
from .vehicles_case import VehiclesCase

__all__ = [
    "CarPath",
    "CarSearch",
    "CarTiming",
    "ParkingCar",
    "ParkingCase",
    "Trailer",
    "VehiclesCase",
    "hybrid_a_star",
    "staged_search",
]
