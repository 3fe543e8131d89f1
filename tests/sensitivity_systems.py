"""Functions whose sensitivity indices are known in closed form."""

import dataclasses

import numpy as np

FOURTH, SIXTH, EIGHTH = np.pi**4 / 5, np.pi**6 / 7, np.pi**8 / 9  # moments of a uniform distribution over (-pi, pi)


@dataclasses.dataclass(frozen=True)
class Ishigami:
    """`sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1` of three inputs that are uniform over `(-pi, pi)` (1990)."""

    a: float = 7.0
    b: float = 0.1
    dimensions: int = 3

    def inputs(self, u):
        return np.pi * (2 * u - 1)

    def __call__(self, x):
        return np.sin(x[:, 0]) * (1 + self.b * x[:, 2] ** 4) + self.a * np.sin(x[:, 1]) ** 2

    def gradients(self, x):
        slope = np.cos(x[:, 0]) * (1 + self.b * x[:, 2] ** 4), self.a * np.sin(2 * x[:, 1])
        return np.stack([*slope, 4 * self.b * x[:, 2] ** 3 * np.sin(x[:, 0])], axis=1)

    @property
    def parts(self):
        """Variance by `x1` alone, `x2` alone, and `x1` with `x3`."""
        first = (1 + self.b * FOURTH) ** 2 / 2
        return first, self.a**2 / 8, self.b**2 * (EIGHTH - FOURTH**2) / 2

    @property
    def variance(self):
        return sum(self.parts)

    @property
    def first(self):
        return np.array([self.parts[0], self.parts[1], 0.0]) / self.variance

    @property
    def total(self):
        return np.array([self.parts[0] + self.parts[2], self.parts[1], self.parts[2]]) / self.variance

    @property
    def squared_correlation(self):
        # E(x1 sin x1) = 1; the function is even in x2, and has the mean zero over x1 at any x3.
        return np.array([(1 + self.b * FOURTH) ** 2 / (np.pi**2 / 3) / self.variance, 0.0, 0.0])

    @property
    def mean_square_gradient(self):
        slope = (1 + 2 * self.b * FOURTH + self.b**2 * EIGHTH) / 2
        return np.array([slope, self.a**2 / 2, 8 * self.b**2 * SIXTH])


@dataclasses.dataclass(frozen=True)
class GFunction:
    """Sobol's product of `(|4 u_i - 2| + a_i) / (1 + a_i)` of inputs that are uniform over `(0, 1)`."""

    a: tuple[float, ...] = (0.0, 1.0, 4.5, 9.0, 99.0)

    @property
    def dimensions(self):
        return len(self.a)

    def __call__(self, u):
        a = np.array(self.a)
        return np.prod((np.abs(4 * u - 2) + a) / (1 + a), axis=1)

    @property
    def _alone(self):
        return 1 / (3 * (1 + np.array(self.a)) ** 2)

    @property
    def variance(self):
        return np.prod(1 + self._alone) - 1

    @property
    def first(self):
        return self._alone / self.variance

    @property
    def total(self):
        alone = self._alone
        return alone * np.prod(1 + alone) / (1 + alone) / self.variance
