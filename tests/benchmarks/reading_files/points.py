"""Problem files whose optima are known."""

from pathlib import Path

COLLECTION = Path(__file__).parent / "collection"
# Best objective of each file, and where it is from.
OPTIMA = {
    "box": 0.25,  # by inspection: (2, 0.5)
    "capacity": 4.0,  # by inspection: the flow 2, the toll 0.25
    "df1": 0.0,  # MacMPEC
    "gauvin": 20.0,  # MacMPEC
    "ralph2": 0.0,  # MacMPEC
}
