"""Parking cases: files as competitions publish them, the car, and the model."""

from pyrobocop_pyomo.car_paths import ParkingCar, ParkingCase
from pyrobocop_pyomo.obstacles import parking_model

__all__ = ["ParkingCar", "ParkingCase", "parking_model"]
