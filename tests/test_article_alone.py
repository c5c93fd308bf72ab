"""Judges the rollouts of the article's cases by a program written from the article alone.

The program knows nothing of the packages. Where the article is silent, it takes the conventions that docs/errata.md
names, and its comments point at them.
"""

from math import copysign, cos, sin

import numpy as np
import pytest

from pidtsm_core.rollouts.closed_loop import rollout

DT, SAMPLES = 0.001, 30_000
R1, R2, M1, M2, J1, J2, G = 1.0, 0.85, 0.5, 1.5, 5.0, 5.0, 9.8
ALPHA, K1, K2, KP, KI, KD, K, KAPPA = 7 / 9, 3.0, 0.5, 2.0, 1.0, 0.5, 1.0, 0.01
# Not printed in the article.
XI, UPSILON, U_S = 0.01, 0.01, 5.0

Pair = tuple[float, float]


class Arm:
    """The arm of (48) to (51) with a mass of the second link."""

    def __init__(self, m2: float) -> None:
        self.p1 = (M1 + m2) * R1**2 + m2 * R2**2 + J1
        self.p2, self.p3 = m2 * R1 * R2, m2 * R2**2
        self.p4 = self.p3 + J2
        self.p5, self.p6 = (M1 + m2) * R1 * G, m2 * R2 * G

    def inertia(self, q2: float) -> tuple[float, float, float]:
        """H0, (48): its elements 11, 12 and 22."""
        return self.p1 + 2 * self.p2 * cos(q2), self.p3 + self.p2 * cos(q2), self.p4

    def bias(self, q: Pair, v: Pair) -> Pair:
        """C0 q' + G0, (49) and (50), as printed."""
        c = self.p2 * sin(q[1])
        g2 = self.p6 * cos(q[0] + q[1])
        return (
            -c * v[0] * v[0] - 2 * c * v[0] * v[1] + self.p5 * cos(q[0]) + g2,
            c * v[1] * v[1] + g2,
        )

    def acceleration(self, q: Pair, v: Pair, torque: Pair) -> Pair:
        """q'' of (5) with the disturbance (51), whose signs are as printed."""
        a, b, d = self.inertia(q[1])
        n1, n2 = self.bias(q, v)
        f1 = torque[0] - n1 + 0.5 * v[0] + sin(3 * q[0]) + 0.5 * sin(v[0])
        f2 = torque[1] - n2 + 1.3 * v[1] - 1.8 * sin(2 * q[1]) + 1.1 * sin(v[1])
        determinant = a * d - b * b
        return (d * f1 - b * f2) / determinant, (a * f2 - b * f1) / determinant

    def step(self, q: Pair, v: Pair, torque: Pair) -> tuple[Pair, Pair]:
        """One classical Runge-Kutta step under a torque that is held."""
        slopes = [(v, self.acceleration(q, v, torque))]
        for h in (DT / 2, DT / 2, DT):
            dq, dv = slopes[-1]
            at = (q[0] + h * dq[0], q[1] + h * dq[1]), (v[0] + h * dv[0], v[1] + h * dv[1])
            slopes.append((at[1], self.acceleration(*at, torque)))
        mean = [
            tuple(DT / 6 * (a[j] + 2 * b[j] + 2 * c[j] + d[j]) for j in (0, 1))
            for a, b, c, d in zip(*slopes, strict=True)
        ]
        return (q[0] + mean[0][0], q[1] + mean[0][1]), (v[0] + mean[1][0], v[1] + mean[1][1])


def desired(t: float) -> tuple[Pair, Pair, Pair]:
    """(52) and its derivatives."""
    a, b = 0.7 * t, 0.5 * t - 0.2
    return (
        (0.2 * cos(a) + 0.2 * cos(b), 0.2 * cos(b) - 0.2 * cos(a)),
        (-0.14 * sin(a) - 0.1 * sin(b), -0.1 * sin(b) + 0.14 * sin(a)),
        (-0.098 * cos(a) - 0.05 * cos(b), -0.05 * cos(b) + 0.098 * cos(a)),
    )


def simulate(payload: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques of 30 s, (samples, 2): rad, N m; the payload (kg) comes at 15 s."""
    model, arm = Arm(M2), Arm(M2)
    q, v, torque = (0.0, -0.1), (0.0, 0.0), (0.0, 0.0)
    integral, tau_sw, gain = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    positions, torques = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    for k in range(SAMPLES):
        acceleration = arm.acceleration(q, v, torque) if k else (0.0, 0.0)  # under the torque held so far
        if k == 15_000:
            arm = Arm(M2 + payload)
        qd, vd, ad = desired(k * DT)
        sigmas, ss, demand = [], [], []
        for j in (0, 1):
            e, de, dde = q[j] - qd[j], v[j] - vd[j], acceleration[j] - ad[j]
            s = de + K1 * (copysign(abs(e) ** ALPHA, e) + e**3) + K2 * e  # (11)
            u_f = min(max(abs(e) ** (ALPHA - 1) * de, -U_S), U_S)  # (13), (29)
            h = K1 * (ALPHA * u_f + 3 * e * e * de) + K2 * de
            pi = KP * s + KI * integral[j]
            sigmas.append(pi + KD * (dde + h))  # (12)
            ss.append(s)
            # (15), (16), (20), (21), solved for the acceleration that the model turns into a torque.
            demand.append(ad[j] - h - (pi - tau_sw[j]) / KD)
        a, b, d = model.inertia(q[1])
        n1, n2 = model.bias(q, v)
        torque = (
            min(max(a * demand[0] + b * demand[1] + n1, -100.0), 100.0),
            min(max(b * demand[0] + d * demand[1] + n2, -50.0), 50.0),
        )
        positions[k], torques[k] = q, torque
        for j in (0, 1):  # explicit Euler, after the torque
            integral[j] += DT * ss[j]
            sign = copysign(1.0, sigmas[j]) if sigmas[j] else 0.0
            tau_sw[j] += DT * (-K * tau_sw[j] - (gain[j] + XI) * sign)  # (25), (26)
            if abs(sigmas[j]) > UPSILON:
                gain[j] += DT * abs(sigmas[j]) / KAPPA  # (27), (30)
        q, v = arm.step(q, v, torque)
    return positions, torques


@pytest.mark.parametrize("payload", [0.0, 0.5], ids=["case1", "case2"])
def test_a_program_written_from_the_article_alone_finds_the_same_motion(payload: float) -> None:
    run = rollout(
        controller={
            "estimator.name": "exact",
            "law.upsilon": UPSILON,
            "law.u_s": U_S,
            "law.xi": XI,
            "law.anti_windup": "none",
        },
        simulator={"payload.mass": payload, "payload.time": 15.0} if payload else {},
        duration=SAMPLES * DT,
    )
    positions, torques = simulate(payload)
    # Beyond rounding, the programs differ only once e has passed zero, where (13) enlarges rounding without a bound.
    np.testing.assert_allclose(run.position[:14_000], positions[:14_000], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run.effort[:14_000], torques[:14_000], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.position, positions, rtol=0.0, atol=1e-6)
