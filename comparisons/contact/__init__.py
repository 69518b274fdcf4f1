"""Rods in contact, solved, beside closed forms, quadratures and rod theory (`pair`, `capstan`, `hertz`, `coil`)."""
