"""The evidence of linear models against the density of one large normal distribution, and its sizes against slopes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import LinAlgError, cho_factor
from scipy.stats import multivariate_normal

from testbench.core.errors import EstimationError
from testbench.inference.first_order import Columns, FirstOrder, Left, sum_of
from testbench.inference.linear import KAPPAS, Grams, Linearised, Motion, factored, fewer, reduced, sized, whitened


def problem(seed, records=2, n=30, p=2, k=3, m=4, q=0, gaps=True):
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(records):
        taken = rng.random((n, p)) > 0.1 * gaps
        out.append(
            Linearised(
                rng.standard_normal((n, p)),
                rng.standard_normal((n, p, k)),
                fewer(rng.standard_normal((n, p, m)), taken),
                taken,
                rng.standard_normal((n, p, q)) if q else None,
            )
        )
    return out


def pulses_of(block):
    """Return the unknown motion of a record by sample, (n, p, m)."""
    return block.unknown.response.transpose(1, 0, 2)


def whole_normal(records, scales, kappa, mean, std):
    """Return ln p of all taken samples as one draw of a normal distribution."""
    rows = [b.taken.ravel() for b in records]
    y = np.concatenate([b.residual.ravel()[r] for b, r in zip(records, rows, strict=True)])
    X = np.concatenate(
        [b.columns.reshape(b.taken.size, b.columns.shape[2])[r] for b, r in zip(records, rows, strict=True)]
    )
    noise = np.concatenate([np.tile(scales, len(b.residual))[r] for b, r in zip(records, rows, strict=True)])
    C = np.diag(noise**2) + (X * std**2) @ X.T
    at = 0
    for b, r in zip(records, rows, strict=True):
        U = pulses_of(b).reshape(len(r), -1)[r]
        C[at : at + len(U), at : at + len(U)] += kappa**2 * U @ U.T
        if b.own is not None:
            V = b.own.reshape(-1, b.own.shape[2])[r]
            C[at : at + len(U), at : at + len(U)] += V @ V.T
        at += len(U)
    return multivariate_normal.logpdf(y, X @ mean, C)


@pytest.mark.parametrize("kappa", [0.0, 0.3])
@pytest.mark.parametrize("which", [[0, 1, 2], [1], []])
@pytest.mark.parametrize("own", [0, 3])
def test_the_evidence_is_the_density_of_one_normal_distribution(kappa, which, own):
    records, scales = problem(1, q=own), np.array([0.8, 1.7])
    records = [replace(b, columns=b.columns[:, :, which]) for b in records]
    mean, std = np.array([0.3, -0.2, 0.1])[which], np.array([0.5, 2.0, 0.1])[which]
    found = reduced([Grams.made(b) for b in records], scales, kappa).log_evidence(mean, std)
    assert found == pytest.approx(whole_normal(records, scales, kappa, mean, std), abs=1e-9)


def test_sums_without_columns_are_those_of_another_residual():
    """A record whose residual is another one, and nothing else, needs only the sums with the residual anew."""
    block = problem(6, records=1, q=2)[0]
    other = np.random.default_rng(7).standard_normal(block.residual.shape)
    found = Grams.made(block).left_by(block, other)
    alone = Linearised(other, block.columns[:, :, :0], block.unknown, block.taken, block.own)
    wanted = Grams.made(alone)
    for ours, theirs in ((found.shared, wanted.shared), (found.across, wanted.across), (found.inside, wanted.inside)):
        assert np.allclose(ours, theirs, rtol=1e-12, atol=1e-12)
    assert (found.k, found.q) == (0, 2)


def test_fewer_directions_of_an_unknown_motion_have_the_evidence_of_all_pulses():
    """Pulses that are sums of others, and pulses too faint to see, add nothing."""
    block = problem(8, records=1, n=60, m=4)[0]
    rng = np.random.default_rng(9)
    four = pulses_of(block)
    U = np.concatenate([four, four @ rng.standard_normal((4, 3)), 1e-5 * four[:, :, :1]], 2)
    few = fewer(U, block.taken)
    assert few.response.shape == (2, 60, 4)
    every = Motion(U.transpose(1, 0, 2), np.einsum("npi,npj->pij", U, U), np.full(8, np.inf))
    both = [
        reduced([Grams.made(Linearised(block.residual, block.columns, V, block.taken))], np.ones(2), 0.5)
        for V in (every, few)
    ]
    assert both[0].log_evidence(np.zeros(3), np.ones(3)) == pytest.approx(
        both[1].log_evidence(np.zeros(3), np.ones(3)), abs=1e-6
    )


def of_columns(records, columns, kappa):
    """Return the records reduced to some of their columns, in noise as stated."""
    return reduced([Grams.made(replace(b, columns=b.columns[:, :, columns])) for b in records], np.ones(2), kappa)


def test_a_library_is_weighed_at_once_as_its_hypotheses_one_by_one():
    """Two residuals of two records, three columns of which the last two belong to one hypothesis each."""
    blocks, others = problem(4), problem(5)
    parts = [Columns.of(b.columns, b.unknown, b.taken) for b in blocks]
    left = [[np.where(b.taken, x.residual, 0.0) for x in (b, o)] for b, o in zip(blocks, others, strict=True)]
    sums = [c.left(np.column_stack([r.ravel() for r in both])) for c, both in zip(parts, left, strict=True)]
    mean, std, sizes = np.array([0.3]), np.array([0.5]), np.array([2.0, 3.0])
    found = FirstOrder.of(sum_of(c.sums for c in parts), sum_of(sums), mean, std, sizes)
    for j, kappa in enumerate(KAPPAS):
        for r in (0, 1):
            whole = [replace(b.unknown, size=np.full(len(b.unknown.size), 1e9)) for b in blocks]  # none is left out
            asked = [Linearised(x[r], b.columns, u, b.taken) for b, u, x in zip(blocks, whole, left, strict=True)]
            alone = of_columns(asked, [0], kappa)
            assert found.alone[j, r] == pytest.approx(alone.log_evidence(mean, std), abs=1e-9)
            for h in (0, 1):
                one, own = of_columns(asked, [0, 1 + h], kappa), (np.append(mean, 0.0), np.append(std, sizes[h]))
                assert found.logs[j, h, r] == pytest.approx(one.log_evidence(*own), abs=1e-9)
                assert found.multiples[j, h, r] == pytest.approx(one.posterior(*own)[0][1], abs=1e-9)


def test_drawn_sums_are_those_of_residuals_with_white_noise():
    """Mean and covariance of 4000 draws: 6 standard errors, which one of 36 entries exceeds once in 10 million sets."""
    block = problem(6, records=1)[0]
    part = Columns.of(block.columns, block.unknown, block.taken)
    multiples, pulses = np.array([1.0, -2.0, 0.5]), np.linspace(-1.0, 1.0, part.U.shape[1])
    drawn = Left.beside([part.drawn(multiples, pulses, np.random.default_rng(i)) for i in range(4000)])
    plain = part.left((part.X @ multiples + part.U @ pulses)[:, None])
    covariance = part.X.T @ part.X  # of inner products with white noise, no motion taken out
    error = np.sqrt(np.diag(covariance) / 4000)
    assert np.all(np.abs(drawn.b[0].mean(axis=1) - plain.b[0, :, 0]) < 6.0 * error)
    spread = np.sqrt((covariance**2 + np.outer(np.diag(covariance), np.diag(covariance))) / 4000)
    assert np.all(np.abs(np.cov(drawn.b[0]) - covariance) < 6.0 * spread)
    assert drawn.c[0].mean() == pytest.approx(
        plain.c[0, 0] + 3 + part.U.shape[1], rel=0.02
    )  # its own degrees of freedom


def test_the_posterior_is_that_of_least_squares_with_priors():
    records, scales = problem(2, gaps=False), np.array([0.8, 1.7])
    mean, std = np.array([0.3, -0.2, 0.1]), np.array([0.5, 2.0, 0.1])
    theta, covariance = reduced([Grams.made(b) for b in records], scales, 0.0).posterior(mean, std)
    X = np.concatenate([(b.columns / scales[:, None]).reshape(-1, 3) for b in records])
    y = np.concatenate([(b.residual / scales).ravel() for b in records])
    H = X.T @ X + np.diag(std**-2)
    assert np.allclose(covariance, np.linalg.inv(H), rtol=1e-10)
    assert np.allclose(theta, np.linalg.solve(H, X.T @ y + mean / std**2), rtol=1e-10)


@pytest.mark.parametrize("kappa", [0.0, 0.1])
def test_sizes_rest_where_the_evidence_has_no_slope(kappa):
    records = [Linearised(b.residual * [1.4, 0.6], b.columns, b.unknown, b.taken) for b in problem(3, records=3, n=100)]
    grams = [Grams.made(b) for b in records]
    mean, std, spread = np.zeros(3), np.array([0.5, 1.0, 0.2]), np.array([0.3, 0.3])
    found = sized(grams, mean, std, spread, kappa)
    assert found.scales == pytest.approx([1.4, 0.6], rel=0.12)

    def density(log_s):
        return reduced(grams, np.exp(log_s), kappa).log_evidence(mean, std) - 0.5 * np.sum((log_s / spread) ** 2)

    log_s = np.log(found.scales)
    for i in range(2):
        h = 1e-4 * np.eye(2)[i]
        assert abs(density(log_s + h) - density(log_s - h)) / 2e-4 < 0.05
        curvature = -(density(log_s + 50 * h) - 2.0 * density(log_s) + density(log_s - 50 * h)) / 25e-6
        assert found.log_errors[i] == pytest.approx(curvature**-0.5, rel=0.1)


def test_noise_that_is_known_stays_as_stated():
    grams = [Grams.made(b) for b in problem(4)]
    assert np.array_equal(sized(grams, np.zeros(3), np.ones(3), np.zeros(2), 0.1).scales, np.ones(2))


def test_the_integral_over_the_scale_is_that_of_quadrature():
    block = problem(5, records=1, n=60, p=1, gaps=False)[0]
    grams, mean, std, spread = [Grams.made(block)], np.zeros(3), np.ones(3), np.array([0.3])
    log_s = np.linspace(-1.2, 1.2, 4001)
    logs = np.array([reduced(grams, np.exp([v]), 0.0).log_evidence(mean, std) for v in log_s])
    logs += -0.5 * (log_s / 0.3) ** 2 - np.log(0.3 * np.sqrt(2.0 * np.pi))
    top = logs.max()
    truth = top + np.log(np.sum(np.exp(logs - top)) * (log_s[1] - log_s[0]))
    assert sized(grams, mean, std, spread, 0.0).log_density == pytest.approx(truth, abs=0.02)


@pytest.mark.parametrize(("own", "kappa"), [(0, 0.0), (0, 0.3), (3, 0.3)])
def test_whitened_records_have_the_sums_that_are_left_once_all_else_is_integrated(own, kappa):
    records, scales = problem(5, q=own), np.array([0.8, 1.7])
    grams = [Grams.made(b) for b in records]
    found = reduced(grams, scales, kappa)
    each = [whitened(b, g, scales, kappa) for b, g in zip(records, grams, strict=True)]
    r = np.concatenate([left.ravel() for left, _ in each])
    X = np.concatenate([columns.reshape(-1, columns.shape[2]) for _, columns in each])
    assert np.allclose(X.T @ X, found.A, rtol=1e-9)
    assert X.T @ r == pytest.approx(found.b, rel=1e-9)
    assert r @ r == pytest.approx(found.c, rel=1e-9)
    assert r.shape == (60 * 2,)


def test_sums_of_very_large_numbers_have_a_factor_and_infinite_ones_are_refused():
    rng = np.random.default_rng(0)
    x = 1e60 * rng.standard_normal((5, 2))
    M = np.eye(5) + x @ x.T  # three eigenvalues are 1, which rounding hides
    with pytest.raises(LinAlgError):
        cho_factor(M)
    factor = factored(M)
    np.testing.assert_allclose(factor[0].T @ factor[0], M, atol=1e-12 * np.abs(M).max())
    assert (np.diag(factor[0]) > 0.0).all()
    with pytest.raises(EstimationError, match="small enough"):
        factored(np.full((2, 2), np.inf))
