"""Theorem 1 for a system, before any run: its constants, the region over which they hold, and what it says.

The constants are taken over the tube that the theorem's own bound makes about q* (see `region`). That is no circle. Let
b(t) be the theorem's bound with some rho, and let rho be at least the flow's largest slope over the tube of radius b. As
|e(t0)| <= b(t0), let t be the last time up to which |e| <= b. Up to t all positions, and the segments from q* to q, lie in
the tube, so that |f~| <= rho |e| there, and the theorem's proof gives |e| < b (1 + 1e-9) for a moment beyond t: the tube
is that much wider, and e never leaves it. The smallest such rho is looked for from below.

Where the gain condition fails, the same holds of the bound with rho = 0 and f_bar enlarged by 2 sqrt(N) sup |f_i|, which
needs no slope; its tube is the region then.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics import vehicles_of
from mjsheaf.backends.system import System
from mjsheaf.checking.assumptions import Assumption, decide
from mjsheaf.checking.drift import Carrier, Difference, difference_along
from mjsheaf.checking.region import Tube, speed_everywhere, tube_about, tube_guessed
from mjsheaf.checking.spectrum import Spectrum, spectrum_of
from mjsheaf.checking.targets import TargetPath, follow_targets, own_rate
from mjsheaf.control.theorem import Theorem, disturbance_bound, theorem_1
from mjsheaf.dynamics.bounds import Supremum
from mjsheaf.dynamics.disturbance import bounds
from mjsheaf.dynamics.effectiveness import without_full_row_rank

Array = NDArray[np.float64]
