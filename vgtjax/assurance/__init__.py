"""Whether a calibration can be signed: what traces can tell, before; what a repetition would give, after."""

from ._certificate import (
    WRONG as WRONG,
    WRONG_ALONE as WRONG_ALONE,
    Certificate as Certificate,
    certified as certified,
    certifying as certifying,
    largest as largest,
)
from ._certified_fit import (
    CertifiedFit as CertifiedFit,
    certified_fit as certified_fit,
    ending_certified as ending_certified,
)
from ._information import (
    NOTHING as NOTHING,
    Information as Information,
    examine as examine,
    examining as examining,
    informing as informing,
)
from ._modes import REPEATED as REPEATED, UNEQUAL as UNEQUAL
from ._next_run import Gain as Gain, next_runs as next_runs, ranking as ranking, remedies as remedies
from ._posterior import (
    CHAINS as CHAINS,
    WARM_UP as WARM_UP,
    Drawn as Drawn,
    Posterior as Posterior,
    Sampler as Sampler,
    require_blackjax as require_blackjax,
)
from ._recovery import Recovery as Recovery, Refit as Refit, Truth as Truth, refitting as refitting
