"""Problems of the textbook table stated a second time, as CasADi functions, where no source gives enough digits."""

from __future__ import annotations

from .stated_before import STATEMENTS as STATED_BEFORE

STATEMENTS = (*STATED_BEFORE,)
