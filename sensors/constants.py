"""Physical constants, SI. One per line, with unit and source."""

STANDARD_GRAVITY = 9.80665  # m/s^2, CGPM 1901 (exact)
SPEED_OF_LIGHT = 299792458.0  # m/s, SI (exact)
EARTH_RATE = 7.2921151467e-5  # rad/s, WGS-84, IS-GPS-200N table 20-IV
WGS84_GM = 3.986005e14  # m^3/s^2, IS-GPS-200N table 20-IV (the value broadcast ephemerides are fitted with)
WGS84_A = 6378137.0  # m, semi-major axis, WGS-84
WGS84_INVERSE_FLATTENING = 298.257223563  # 1, WGS-84
GRAVITY_EQUATOR = 9.7803253359  # m/s^2, normal gravity at the equator, WGS-84 (NIMA TR8350.2, table 3.4)
GRAVITY_FORMULA = 0.00193185265241  # 1, Somigliana's constant k, WGS-84 (NIMA TR8350.2, table 3.4)
GAS_CONSTANT_AIR = 287.05287  # J/(kg K), dry air, ISO 2533:1975
HEAT_CAPACITY_RATIO_AIR = 1.4  # 1, ISO 2533:1975
SEA_LEVEL_PRESSURE = 101325.0  # Pa, ISO 2533:1975
SEA_LEVEL_TEMPERATURE = 288.15  # K, ISO 2533:1975
LAPSE_RATE = 0.0065  # K/m, troposphere, ISO 2533:1975
ZERO_CELSIUS = 273.15  # K, SI (exact)
REFERENCE_TEMPERATURE = 25.0  # degC, the T0 of every temperature effect (docs: EFFECTS)
