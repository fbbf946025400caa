# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A first filter by hand
#
# A vehicle hovers. Its barometer is off by an unknown bias and noisy; a laser sees the ground. How high is it, and
# what is the bias? First with three lines of linear algebra, then with the filter of `sinan`, step by step.

# %%
import matplotlib.pyplot as plt
import numpy as np

import sinan

flight = sinan.simulate("hover", seed=1)
baro, laser = flight.streams["baro"], flight.streams["laser"]
print(f"{len(baro.t)} heights of the barometer, {len(laser.t)} ranges of the laser")

# %% [markdown]
# ## Two states
#
# State: height h and bias b. A reading of the barometer is h + b, of the laser h. Between readings the height wanders
# a little, so its variance grows by q = (0.1 m/sqrt(s))² t; the bias stays. This is a whole Kalman filter:

# %%
x, P = np.array([5.0, 0.0]), np.diag([1.0, 4.0])
MODELS = {"baro": (np.array([1.0, 1.0]), 0.3**2), "laser": (np.array([1.0, 0.0]), 0.03**2)}
readings = sorted(
    [(t, "baro", z) for t, z in zip(baro.t, baro.columns["height"], strict=True)]
    + [(t, "laser", z) for t, z in zip(laser.t, laser.columns["range"], strict=True)]
)
now, course = 0.0, []
for t, sensor, z in readings:
    P[0, 0] += 0.1**2 * (t - now)  # predict
    now = t
    H, R = MODELS[sensor]
    nu = z - H @ x  # innovation: reading less prediction
    S = H @ P @ H + R  # its variance
    K = P @ H / S  # gain
    x, P = x + K * nu, P - np.outer(K, H @ P)  # update
    course.append((t, *x, *np.sqrt(np.diag(P))))
t, h, b, sigma_h, sigma_b = np.array(course).T
print(f"bias {b[-1]:.2f} +- {sigma_b[-1]:.2f} m")

# %% [markdown]
# The truth is in the recording, for scoring alone. Does the error stay within two sigma?

# %%
truth = flight.truth.stream
figure, axes = plt.subplots(figsize=(8, 3))
axes.fill_between(t, b - 2 * sigma_b, b + 2 * sigma_b, alpha=0.2)
axes.plot(t, b, label="estimate, two sigma")
axes.plot(truth.t, truth.columns["bias_baro"], "k", label="truth")
axes.set(xlabel="time [s]", ylabel="bias of the barometer [m]", xlim=(0, 20))
axes.legend()

# %% [markdown]
# ## The same in 22 states
#
# `sinan.steps` runs the error-state filter and stops after every predict and update, with everything in sight. Twenty
# seconds of it:

# %%
moments = []
for moment in sinan.steps(flight):
    if moment.t > 20.0:
        break
    if moment.kind == "update" and moment.sensor == "baro":
        moments.append((moment.t, moment.state["b_baro"][0], moment.sigma["b_baro"][0], moment.nis))
t, b, sigma, nis = np.array(moments).T
figure, axes = plt.subplots(figsize=(8, 3))
axes.fill_between(t, b - 2 * sigma, b + 2 * sigma, alpha=0.2)
axes.plot(t, b, label="estimate, two sigma")
axes.plot(truth.t, truth.columns["bias_baro"], "k", label="truth")
axes.set(xlabel="time [s]", ylabel="bias of the barometer [m]", xlim=(0, 20))
axes.legend()
print(f"mean NIS of the barometer {np.mean(nis):.2f}; one if the filter knows how wrong it is")

# %% [markdown]
# What of a moment would you like to see? `moment.H`, `moment.S`, `moment.K`, `moment.covariance`: print their shapes,
# and find the column of `H` where the bias of the barometer is.

# %%
true_bias = np.interp(t[-1], truth.t, truth.columns["bias_baro"])
assert abs(b[-1] - true_bias) < 3 * sigma[-1]
assert 0.8 < np.mean(nis) < 1.2
