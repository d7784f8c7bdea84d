"""The membrane of api/examples/obstacle_membrane.json at rest, by harmonic functions and a free boundary of Fourier modes.

Between the free boundary r = rho(theta) and the square |x|, |y| < 2 the membrane u is harmonic and has the symmetries of the
square: u = a log r + b + sum (c_k r^(4k) + d_k r^(-4k)) cos 4k theta. On the square u = 0; on the free boundary u and its
radial derivative are those of the hemisphere. Least squares at many points, Newton in rho (and all is linear but rho).
Prints u at (1, 0), and by how much it changes from one number of modes to the next.
"""

import numpy as np

SIDE = 2.0


def harmonics(r, theta, modes):
    """Each function and its radial derivative at points, scaled so that none is large within the square."""
    values, slopes = [np.log(r), np.ones_like(r)], [1 / r, np.zeros_like(r)]
    for k in range(1, modes):
        outer, inner, wave = SIDE * np.sqrt(2), 0.6, np.cos(4 * k * theta)
        values += [(r / outer) ** (4 * k) * wave, (inner / r) ** (4 * k) * wave]
        slopes += [4 * k / r * (r / outer) ** (4 * k) * wave, -4 * k / r * (inner / r) ** (4 * k) * wave]
    return np.array(values).T, np.array(slopes).T


def beside(modes):
    angles = (np.arange(6 * modes) + 0.5) / (6 * modes) * np.pi / 4
    side = SIDE / np.cos(angles)
    waves = np.cos(4 * np.outer(angles, np.arange(modes)))
    rho = np.zeros(modes)
    rho[0] = 0.7
    count = 2 * modes
    coefficients = np.zeros(count)
    on_side, _ = harmonics(side, angles, modes)
    for _ in range(40):
        r = waves @ rho
        on_free, slopes = harmonics(r, angles, modes)
        height = np.sqrt(1 - r**2)
        # Radial derivatives of the two conditions on the free boundary between the membrane u and the obstacle psi:
        # that of u - psi = 0 is u_r - psi_r, and that of u_r - psi_r = 0 is u_rr - psi_rr, with u_rr by central
        # differences.
        _, ahead = harmonics(r + 1e-6, angles, modes)
        _, behind = harmonics(r - 1e-6, angles, modes)
        bend = ((ahead - behind) / 2e-6) @ coefficients + 1 / height**3
        tilt = slopes @ coefficients + r / height
        residual = np.concatenate([on_side @ coefficients, on_free @ coefficients - height, tilt])
        zero = np.zeros((len(angles), modes))
        jacobian = np.block([[on_side, zero], [on_free, tilt[:, None] * waves], [slopes, bend[:, None] * waves]])
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        coefficients, rho = coefficients + step[:count], rho + step[count:]
        if np.abs(step[count:]).max() < 1e-13:
            break
    return (harmonics(np.array([1.0]), np.array([0.0]), modes)[0] @ coefficients)[0], np.abs(residual).max()


if __name__ == "__main__":
    for modes in (4, 6, 8, 10, 12):
        print(modes, *beside(modes))
