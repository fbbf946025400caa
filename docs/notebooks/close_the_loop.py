# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Close the loop
#
# Find the residual, trace it to an effect, add the effect, and show the error on readings that took no part. The
# recording is of a magnetometer that was turned by hand; what is wrong with it is known to the simulator only.

# %%
import numpy as np

import sinan

poses = sinan.simulate("mag_poses", seed=7, effects={"mag.cross_axis": [0.04, -0.015, 0.02]})

# %% [markdown]
# ## 1. The textbook's model
#
# Scale and offset, so that the norm of a reading is that of the field.

# %%
calibrations = sinan.calibrate(poses)
print(calibrations)
calibrations.plot_norm("mag")

# %% [markdown]
# The residual is larger than the noise that the recording declares: the model lacks something. But what?
#
# ## 2. Which effect?
#
# Every effect of the catalogue that a magnetometer's poses can have is asked at once.

# %%
trace = sinan.trace(poses)
print(trace.headline)
trace.candidates()

# %%
trace.plot_candidates()

# %% [markdown]
# ## 3. Is it proved?
#
# Every fifth block of readings took no part in a second fit. There the error fell:

# %%
trace.errors()

# %% [markdown]
# ## 4. And was it right?
#
# Here the answer is known: the effect that was hidden, with its three parameters.

# %%
trace.effects()

# %%
assert trace.found == ("mag.cross_axis",)
found = trace.document["effects"][0]
assert np.all(np.abs(np.array(found["beta"]) - [0.04, -0.015, 0.02]) < 4 * np.array(found["std"]))
errors = trace.document["error"]
assert errors["after"]["rms"] < 0.4 * errors["before"]["rms"]
