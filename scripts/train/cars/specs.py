"""Dimensions of the real vehicles that the built cars vary about.

Every row holds a maker's published exterior figures, written down from memory and rounded to the centimetre. They are
ESTIMATES, with errors of about ±1 % in length, width, height and wheelbase, and ±2 % in track and tyre. The front
overhang, which makers rarely publish, has ±5 cm. Width is without mirrors, height without roof rails.
"""

from __future__ import annotations

from dataclasses import dataclass

# Share of each body type in traffic and car parks: ESTIMATE for North America, Europe and Brazil 1998–2018.
TRAFFIC_SHARE = {
    "sedan": 0.34, "hatchback": 0.18, "wagon": 0.05, "suv": 0.19, "minivan": 0.07, "van": 0.04,
    "pickup": 0.09, "coupe": 0.04,
}  # fmt: skip


@dataclass(frozen=True)
class Spec:
    """Published dimensions of one model, metres."""

    name: str
    body: str
    length: float
    width: float
    height: float
    wheelbase: float
    front_overhang: float
    track: float
    tyre_diameter: float
    split: str  # "train" or "eval": models of one split never appear in the other


# name, length, width, height, wheelbase, overhang, track (mean of axles), tyre diameter; "*": split eval
_TABLE = {
    "sedan": """
        toyota-camry-2007      4.81 1.82 1.47 2.78 0.97 1.57 0.66
        toyota-corolla-2003    4.53 1.70 1.48 2.60 0.89 1.48 0.63
        honda-accord-2008      4.93 1.85 1.48 2.80 0.98 1.58 0.67
        honda-civic-2006       4.49 1.75 1.44 2.70 0.90 1.51 0.63
        nissan-altima-2002     4.86 1.79 1.47 2.80 0.97 1.55 0.65
        nissan-sentra-2007     4.57 1.79 1.51 2.69 0.92 1.55 0.63
        bmw-3-e90              4.52 1.82 1.42 2.76 0.77 1.51 0.63
        mercedes-c-w204        4.58 1.77 1.45 2.76 0.80 1.54 0.63
        audi-a4-b7             4.59 1.77 1.43 2.65 0.96 1.52 0.63
        ford-taurus-2000       5.02 1.85 1.43 2.76 1.06 1.56 0.65
        chevrolet-impala-2006  5.09 1.85 1.49 2.81 1.05 1.57 0.67
        ford-crown-vic-2003    5.39 1.96 1.48 2.91 1.08 1.61 0.69
        fiat-siena-2004        4.14 1.64 1.43 2.37 0.78 1.42 0.58
        dacia-logan-2005       4.25 1.74 1.53 2.63 0.80 1.47 0.60
        opel-vectra-c          4.60 1.80 1.46 2.70 0.93 1.53 0.63
        *volkswagen-passat-b6  4.77 1.82 1.47 2.71 0.94 1.55 0.63
        *hyundai-elantra-2011  4.53 1.78 1.43 2.70 0.89 1.55 0.63
        *ford-fusion-2010      4.84 1.83 1.45 2.73 0.98 1.56 0.66
        *chevrolet-classic     4.15 1.61 1.42 2.44 0.80 1.40 0.58""",
    "hatchback": """
        volkswagen-golf-5      4.20 1.76 1.48 2.58 0.88 1.53 0.63
        volkswagen-gol-g4      3.93 1.62 1.42 2.47 0.77 1.39 0.58
        fiat-palio-2004        3.84 1.63 1.43 2.37 0.74 1.42 0.58
        fiat-uno-2010          3.77 1.64 1.48 2.38 0.75 1.43 0.58
        chevrolet-corsa-c      3.82 1.65 1.44 2.49 0.79 1.43 0.58
        ford-fiesta-2002       3.92 1.68 1.46 2.49 0.79 1.46 0.60
        ford-focus-1999        4.15 1.70 1.43 2.62 0.86 1.49 0.61
        peugeot-206            3.84 1.65 1.43 2.44 0.78 1.43 0.58
        renault-clio-2         3.77 1.64 1.42 2.47 0.77 1.40 0.58
        honda-fit-2008         3.90 1.70 1.53 2.50 0.81 1.48 0.60
        toyota-prius-2004      4.45 1.73 1.49 2.70 0.91 1.50 0.62
        mini-2002              3.63 1.69 1.41 2.47 0.70 1.46 0.58
        mazda-3-2004           4.42 1.76 1.47 2.64 0.90 1.53 0.63
        *opel-astra-h          4.25 1.75 1.46 2.61 0.90 1.49 0.63
        *toyota-yaris-2006     3.75 1.70 1.53 2.46 0.78 1.47 0.60
        *renault-megane-2      4.21 1.78 1.46 2.63 0.83 1.51 0.62""",
    "wagon": """
        volvo-v70-2001         4.71 1.80 1.49 2.75 0.93 1.56 0.64
        subaru-outback-2005    4.73 1.77 1.55 2.67 0.97 1.50 0.67
        volkswagen-passat-v-b5 4.67 1.75 1.50 2.70 0.98 1.51 0.63
        audi-a4-avant-b6       4.54 1.77 1.43 2.65 0.93 1.52 0.63
        opel-astra-caravan     4.52 1.75 1.50 2.70 0.89 1.49 0.63
        ford-focus-wagon       4.47 1.70 1.45 2.62 0.87 1.49 0.61
        fiat-palio-weekend     4.22 1.63 1.52 2.44 0.75 1.42 0.60
        skoda-octavia-combi    4.57 1.77 1.47 2.58 0.91 1.54 0.63
        *bmw-3-touring-e91     4.52 1.82 1.42 2.76 0.77 1.51 0.63
        *peugeot-406-break     4.74 1.77 1.50 2.70 0.99 1.52 0.63""",
    "suv": """
        toyota-rav4-2006       4.60 1.82 1.69 2.66 0.90 1.56 0.70
        honda-cr-v-2007        4.52 1.82 1.68 2.62 0.88 1.57 0.69
        ford-escape-2008       4.44 1.81 1.72 2.62 0.87 1.54 0.70
        ford-explorer-2002     4.81 1.83 1.81 2.89 0.87 1.55 0.74
        jeep-grand-cherokee-05 4.75 1.86 1.74 2.78 0.85 1.58 0.74
        jeep-cherokee-1998     4.25 1.72 1.63 2.58 0.70 1.47 0.71
        chevrolet-tahoe-2007   5.13 2.01 1.95 2.95 1.00 1.72 0.79
        nissan-x-trail-2008    4.63 1.79 1.69 2.63 0.92 1.54 0.69
        nissan-qashqai-2007    4.32 1.78 1.61 2.63 0.88 1.54 0.68
        ford-ecosport-2004     4.23 1.73 1.68 2.49 0.81 1.49 0.65
        bmw-x5-2007            4.85 1.93 1.77 2.93 0.86 1.65 0.75
        lexus-rx-2004          4.73 1.85 1.68 2.72 0.94 1.57 0.73
        *honda-pilot-2003      4.78 1.96 1.79 2.70 0.95 1.69 0.73
        *hyundai-tucson-2010   4.41 1.82 1.66 2.64 0.88 1.59 0.70
        *toyota-4runner-2003   4.80 1.88 1.76 2.79 0.86 1.58 0.76""",
    "minivan": """
        honda-odyssey-2005     5.11 1.96 1.75 3.00 0.97 1.69 0.68
        toyota-sienna-2004     5.08 1.97 1.75 3.03 0.98 1.68 0.68
        dodge-caravan-2001     4.81 2.00 1.75 2.88 0.97 1.62 0.66
        chrysler-town-2008     5.14 1.95 1.75 3.08 0.98 1.65 0.68
        volkswagen-touran      4.39 1.79 1.64 2.68 0.90 1.54 0.63
        renault-scenic-2       4.26 1.81 1.62 2.69 0.84 1.51 0.63
        opel-zafira-b          4.47 1.80 1.64 2.70 0.92 1.50 0.63
        opel-meriva-a          4.04 1.69 1.62 2.63 0.80 1.45 0.60
        citroen-picasso-1999   4.28 1.75 1.64 2.76 0.77 1.47 0.61
        *ford-s-max-2006       4.77 1.85 1.66 2.85 0.95 1.59 0.66
        *kia-sedona-2006       5.13 1.99 1.76 3.02 0.98 1.69 0.68""",
    "van": """
        ford-transit-2006-l2   5.23 1.97 2.07 3.30 0.93 1.72 0.68
        volkswagen-t5          4.89 1.90 1.97 3.00 0.91 1.63 0.66
        mercedes-vito-w639     5.01 1.90 1.91 3.20 0.82 1.63 0.66
        renault-trafic-2       4.78 1.90 1.97 3.10 0.83 1.62 0.65
        ford-e-series          5.50 2.01 2.10 3.51 0.78 1.74 0.74
        chevrolet-express-2003 5.69 2.01 2.07 3.43 0.91 1.73 0.74
        mercedes-sprinter-906  5.26 1.99 2.44 3.25 1.00 1.71 0.69
        fiat-ducato-2006       5.41 2.05 2.25 3.45 0.95 1.80 0.69
        citroen-berlingo-1999  4.11 1.72 1.80 2.69 0.74 1.42 0.62
        *fiat-doblo-2005       4.25 1.72 1.82 2.58 0.83 1.50 0.62
        *renault-master-2      5.40 1.99 2.25 3.58 0.86 1.75 0.68""",
    "pickup": """
        ford-f150-2004-crew    5.69 2.00 1.89 3.52 0.96 1.70 0.78
        ford-f150-2004-regular 5.36 2.00 1.86 3.20 0.96 1.70 0.78
        chevrolet-silverado-07 5.84 2.03 1.87 3.64 0.99 1.72 0.79
        dodge-ram-2002-quad    5.79 2.02 1.92 3.57 0.95 1.73 0.79
        toyota-tacoma-2005-dc  5.29 1.90 1.78 3.24 0.88 1.60 0.76
        toyota-hilux-2005-dc   5.26 1.84 1.81 3.09 0.89 1.54 0.77
        nissan-frontier-2005   5.22 1.85 1.77 3.20 0.85 1.57 0.75
        mitsubishi-l200-2006   5.00 1.80 1.78 3.00 0.80 1.52 0.74
        fiat-strada-2004       4.45 1.66 1.59 2.72 0.78 1.43 0.60
        volkswagen-saveiro-g5  4.49 1.71 1.52 2.75 0.82 1.46 0.61
        *ford-ranger-1998-ext  5.15 1.76 1.72 3.20 0.80 1.48 0.72
        *toyota-tundra-2007-dc 5.81 2.03 1.94 3.70 1.00 1.73 0.81""",
    "coupe": """
        ford-mustang-2005      4.78 1.88 1.38 2.72 0.95 1.58 0.68
        honda-civic-coupe-2006 4.44 1.75 1.40 2.65 0.89 1.50 0.63
        honda-accord-coupe-08  4.85 1.85 1.43 2.74 0.98 1.58 0.67
        bmw-3-coupe-e92        4.58 1.78 1.40 2.76 0.79 1.51 0.64
        audi-tt-2007           4.18 1.84 1.35 2.47 0.88 1.57 0.64
        infiniti-g35-coupe     4.63 1.82 1.39 2.85 0.79 1.54 0.66
        hyundai-tiburon-2003   4.40 1.76 1.33 2.53 0.92 1.49 0.63
        chevrolet-camaro-2010  4.84 1.92 1.38 2.85 0.94 1.62 0.72
        *nissan-350z           4.31 1.82 1.32 2.65 0.80 1.54 0.67
        *chevrolet-cobalt-cpe  4.58 1.73 1.41 2.62 0.93 1.48 0.62""",
}


def _parse() -> list[Spec]:
    specs = []
    for body, text in _TABLE.items():
        for row in text.strip().splitlines():
            name, *figures = row.split()
            split = "eval" if name.startswith("*") else "train"
            specs.append(Spec(name.lstrip("*"), body, *map(float, figures), split))
    return specs


SPECS = _parse()
