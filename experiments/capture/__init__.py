"""`sinan capture`: readings of a vehicle that is there now, over MAVLink, as a recording; poses shown one by one.

`link` carries bytes, `clock` tells when a reading was taken, `vehicle` asks for what is wanted, `session` writes it
down; `poses` and `faces` say what a calibration still wants to be shown.
"""
