"""What a trace found, in a flight controller's own parameters: PX4's and ArduPilot's.

Each effect is put into the correction that the autopilot itself applies, combined with what the log's parameters have
put into the readings already. Corrections that act before a reading is logged (`CAL_*`, `COMPASS_*`, `INS_*`) are
combined; those of its estimator (`EKF2_*`, `EK3_*`, lever arms, delays), which no logged reading has in it, are set.
"""
