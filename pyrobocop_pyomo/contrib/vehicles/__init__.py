"""Paths of cars among obstacles: hybrid A* with Reeds-Shepp paths, parking cases from files, many vehicles in turn."""

from .car_kinematics import Trailer
from .car_path import CarPath, CarTiming
from .hybrid_a_star import hybrid_a_star
from .motion_primitives import CarSearch
from .parking_case import ParkingCar, ParkingCase
from .parking_model import parking_model
from .vehicles_case import VehiclesCase
from .vehicles_in_turn import VehicleMove, VehiclesPlan, plan_vehicles

__all__ = [
    "CarPath",
    "CarSearch",
    "CarTiming",
    "ParkingCar",
    "ParkingCase",
    "Trailer",
    "VehicleMove",
    "VehiclesCase",
    "VehiclesPlan",
    "hybrid_a_star",
    "parking_model",
    "plan_vehicles",
]
