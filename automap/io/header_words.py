"""The words of column names in English, German, French, Spanish, Portuguese, Italian and Dutch.

Words are in lower case without accents; a star stands for any ending.
"""

from __future__ import annotations

COMMON = {
    "time": "t time times timestamp* stamp zeit zeitstempel zeitpunkt temps heure horodatage "
    "tiempo hora horario tempo ora orario tijd tijdstip tijdstempel epoch* millis micros nanos "
    "seconds sekunden secondes segundos secondi seconden sec clock elapsed uhr uhrzeit datetime "
    "utc gpst unixtime posixtime ts hh",
    "date": "date datum fecha data jour yyyy",
    "week": "week woche semaine semana settimana",
    "tow": "tow itow sow",
    "speed": "speed spd sog gs geschwindigkeit geschw vitesse velocidad velocidade velocita "
    "velocity vel snelheid groundspeed mps",
    "rate": "rate rates",
}

IMU = {
    "gyro": "gyr gyro* gyrosc* giro* kreisel* omega rot rotation* rotazione rotacion drehrate* "
    "drehraten winkelgeschwindigkeit* hoeksnelheid draaisnelheid turnrate w wb g",
    "angular": "angular angulaire angolare ang winkel hoek",
    "accel": "acc accel* acceler* aceler* beschl* versnelling* acelerometro accelerometro a fb f "
    "specific force kraft spezifische linacc",
    "roll": "roll wank roulis rollio",
    "pitch": "pitch nick tangage beccheggio cabeceo stampf",
    "yaw": "yaw gier lacet imbardata guinada",
    "temp": "temp temperature temperatur temperatura temperatuur celsius",
    "other": "user gravity schwerkraft mag magnet* quat* orientation attitude bias offset sd std "
    "stdev sigma var cov* error err accuracy norm magnitude reference heading count lateral "
    "longitudinal",
}

GNSS = {
    "lat": "lat latitude latitud latitudine breite breitengrad breedte breedtegraad",
    "lon": "lon long lng longitude longitud longitudine lange langengrad laenge laengengrad lengte "
    "lengtegraad",
    "height": "height",
    "altitude": "alt altitude altitud altitudine quota elev elevation ele hohe hoehe hauteur "
    "altura altezza hoogte",
    "ellipsoidal": "hae ellips* ellipsoid*",
    "sealevel": "msl amsl orthometric* sea meer mer mare mar nn nap",
    "geoid": "geoid* undulation* undulacion separation sep",
    "horizontal": "horizontal* hor h orizzontale",
    "vertical": "vertical* ver vert verticale vertikal*",
    "accuracy": "acc accuracy accur* genauigkeit precision precisione exactitud accuratezza "
    "nauwkeurigheid error err fehler uncertainty",
    "sd": "sd std stdev stddev sigma standardabweichung s",
    "course": "course cog kurs cap rumbo rumo rotta koers track trk tmg bearing route richtung "
    "direction direccion direcao direzione fahrtrichtung rijrichting",
    "heading": "heading head hdg orientation",
    "north": "n north nord norte noord",
    "east": "e east est ost este oost",
    "down": "d down unten",
    "up": "u up hoch climb",
    "quality": "fix fixtype quality qualitat qualite calidad qualita kwaliteit q fixquality",
    "sats": "sats sat satellites satellite satelliten satelites satelliti satellieten nsat nsats "
    "numsv numsats ns sv svs",
    "hdop": "hdop",
    "arrival": "arrival received ankunft",
    "speed": "v",
    "other": "lateral longitudinal accel* steering throttle engine mag* compass kompass boussole "
    "brujula bussola kompas wind limit max min avg average target",
}

ODOMETER = {
    "speed": "v wheelspeed radgeschwindigkeit raddrehzahl tacho",
    "other": "angular angulaire angolare winkel* accel* acceler* aceler* beschl* gyro* giro* x y z",
}

ARRIVAL = {"offset": "offset byte bytes versatz"}

NEUTRAL = frozenset(
    [
        "raw",
        "axis",
        "achse",
        "axe",
        "eje",
        "asse",
        "as",
        "calibrated",
        "uncalibrated",
        "sensor",
        "imu",
        "value",
        "wert",
        "val",
        "mems",
        "the",
        "of",
        "gps",
        "gnss",
        "location",
        "loc",
        "pos",
        "position",
        "place",
        "geo",
        "geogr",
        "geographical",
        "wgs",
        "ground",
        "over",
        "true",
        "used",
        "use",
        "wheel",
        "rad",
        "vehicle",
        "obd",
        "can",
        "car",
        "fahrzeug",
        "roue",
        "rueda",
        "ruota",
        "wiel",
        "motion",
        "num",
        "number",
        "type",
        "mode",
        "in",
        "component",
        "body",
        "frame",
        "de",
        "la",
        "del",
        "della",
        "du",
        "di",
        "von",
        "der",
        "die",
        "das",
        "am",
        "total",
        "degrees",
        "grad",
    ]
)
"""Words that change nothing."""

COMPOUNDS: dict[str, tuple[str, ...]] = {
    "hacc": ("horizontal", "accuracy"),
    "vacc": ("vertical", "accuracy"),
    "sacc": ("speed", "accuracy"),
    "cacc": ("course", "accuracy"),
    "epe": ("accuracy",),
    "eph": ("horizontal", "accuracy"),
    "epv": ("vertical", "accuracy"),
    "eps": ("speed", "accuracy"),
    "gf": ("accel",),
    "hmsl": ("sealevel",),
    "vn": ("speed", "north"),
    "ve": ("speed", "east"),
    "vd": ("speed", "down"),
    "vu": ("speed", "up"),
    "veln": ("speed", "north"),
    "vele": ("speed", "east"),
    "veld": ("speed", "down"),
    "velu": ("speed", "up"),
    "sdn": ("sd", "north"),
    "sde": ("sd", "east"),
    "sdd": ("sd", "down"),
    "sdu": ("sd", "up"),
}

RULES: dict[str, dict[str, str]] = {
    "gnss": {
        "lat": "lat",
        "lon": "lon",
        "height": "height+ellipsoidal, altitude+ellipsoidal, ellipsoidal, height",
        "msl": "altitude, sealevel, height+sealevel, altitude+sealevel",
        "geoid_sep": "geoid, geoid+height, geoid+altitude, geoid+sd",
        "h_acc": "horizontal+accuracy, accuracy, horizontal+sd",
        "v_acc": "vertical+accuracy, altitude+accuracy, height+accuracy, vertical+sd",
        "sd_n": "sd+north, sd+lat, lat+accuracy, north+accuracy",
        "sd_e": "sd+east, sd+lon, lon+accuracy, east+accuracy",
        "sd_d": "sd+down, sd+up, sd+altitude, sd+height",
        "speed": "speed+horizontal, speed",
        "course": "course, heading",
        "vn": "speed+north",
        "ve": "speed+east",
        "vd": "speed+down",
        "vu": "speed+up, speed+vertical",
        "speed_acc": "speed+accuracy, speed+sd",
        "course_acc": "course+accuracy, course+sd",
        "quality": "quality",
        "n_sats": "sats",
        "hdop": "hdop",
        "arrival": "arrival, arrival+time",
    },
    "odometer": {"speed": "speed"},
    "arrival": {"offset": "offset"},
    "imu": {"temp_c": "temp"},
}
"""Kind of table -> our name -> the sets of meanings that say it, the preferred one first."""

TIME_OR_SPEED = "tempo"
"""A time in Italian and Portuguese, a speed in German."""
