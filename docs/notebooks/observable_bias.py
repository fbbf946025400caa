# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A bias made observable
#
# A filter can only find what the motion shows. Which biases does a hover leave open, and what has to be flown?

# %%
import matplotlib.pyplot as plt
import numpy as np

import sinan

hover, flown = (sinan.observability(name) for name in ("hover", "aerobatics"))

# %% [markdown]
# The readings of a flight say about each state how much of its first sigma is left. One: nothing was seen.

# %%
left = {
    name: [entry["posterior"] / entry["prior"] for entry in answer.document["biases"].values()]
    for name, answer in (("hover", hover), ("aerobatics", flown))
}
names = list(hover.document["biases"])
figure, axes = plt.subplots(figsize=(8, 3.4))
place = np.arange(len(names))
for k, (name, values) in enumerate(left.items()):
    axes.bar(place + 0.4 * k, values, 0.4, label=name)
axes.set_xticks(place + 0.2, names, rotation=60, ha="right")
axes.set_ylabel("sigma left, of that before")
axes.legend()
figure.tight_layout()

# %% [markdown]
# The bias of the accelerometer along x goes with the tilt: a body that is pitched by 0.01 rad and one whose
# accelerometer is off by 0.1 m/s² read the same, as long as nothing moves. The report says so in words, and what
# would help:

# %%
for direction in hover.document["weak_directions"][:2]:
    print(direction["sentence"])
print(hover.document["advice"][0])

# %% [markdown]
# ## See it in the filter
#
# The bias of the accelerometer along x, with its two sigma, in a hover and in a flight that turns and climbs.

# %%
figure, axes = plt.subplots(1, 2, figsize=(8, 3), sharey=True)
ends = {}
for one, name in zip(axes, ("hover", "figure_eight"), strict=True):
    flight = sinan.simulate(name, seed=3)
    course = sinan.estimate(flight).states()
    truth = flight.truth.stream
    error = course["b_accel_x"] - np.interp(course.index, truth.t, truth.columns["bias_accel_x"])
    sigma = course["b_accel_x_std"]
    one.fill_between(course.index, -2 * sigma, 2 * sigma, alpha=0.2)
    one.plot(course.index, error)
    one.set(title=name, xlabel="time [s]", ylim=(-0.15, 0.15))
    ends[name] = float(sigma.iloc[-1])
axes[0].set_ylabel("error of the bias along x [m/s²]")

# %%
assert ends["hover"] > 3 * ends["figure_eight"]
