# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Differential GPS in the position domain
#
# A receiver's error has two parts: noise, which is gone from one fix to the next, and what is left of orbits, clocks
# and atmosphere, which moves slowly. A filter can average the first. The second is a bias, and nothing aboard tells
# it from a shift of the place.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import sinan

with_base = sinan.simulate("base_receiver", seed=1)
alone = replace(with_base, streams={name: s for name, s in with_base.streams.items() if name != "base"})

# %% [markdown]
# A base at a known place reads its own position wrong by the same bias: `p_base,meas - p_base = b_gps + n`. To the
# filter that is one more sensor, with H the identity on the block `b_gps`.

# %%
truth = with_base.truth.stream
figure, axes = plt.subplots(1, 2, figsize=(8, 3), sharey=True)
rms, sigmas = {}, {}
for one, (name, flight) in zip(axes, {"GPS alone": alone, "with a base": with_base}.items(), strict=True):
    course = sinan.estimate(flight).states()
    error = course["position_north"] - np.interp(course.index, truth.t, truth.columns["north"])
    sigma = course["position_north_std"]
    one.fill_between(course.index, -2 * sigma, 2 * sigma, alpha=0.2)
    one.plot(course.index, error)
    one.set(title=name, xlabel="time [s]", ylim=(-2, 2))
    late = course.index > 10.0
    rms[name], sigmas[name] = float(np.sqrt(np.mean(error[late] ** 2))), float(sigma.iloc[-1])
axes[0].set_ylabel("error north [m]")
print({name: f"{value:.2f} m" for name, value in rms.items()})

# %% [markdown]
# Alone the filter knows that it does not know: its sigma stays at that of the bias. What limits it with a base? The
# base's noise, and how fast the bias moves between its readings; in life also what the two receivers do not share
# ([the sensor's page](../sensors/gps.md)).

# %%
assert rms["with a base"] < 0.5 * rms["GPS alone"]
assert sigmas["GPS alone"] > 3 * sigmas["with a base"]
