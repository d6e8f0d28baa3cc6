"""Tables in the languages and number formats of the world's spreadsheets."""

from __future__ import annotations

from pathlib import Path

from tests.unit.strangers.drive import (
    DEG,
    EN_IMU,
    PER_G,
    Truth,
    en_imu,
    fix_rows,
    imu_rows,
    iso,
    seconds,
    stamp,
    truth,
    write,
)


def german_excel(folder: Path) -> Truth:
    """Excel: BOM, CRLF, semicolons, an index, date beside a time of day with a decimal comma."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%d.%m.%Y", t), stamp("%H:%M:%S,%L", t)]

    rows = imu_rows(of, when, DEG, PER_G)
    write(
        folder / "Messung.csv",
        "Nr.;Datum;Uhrzeit;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s];"
        "Beschleunigung X [g];Beschleunigung Y [g];Beschleunigung Z [g]",
        ([str(n + 1), *row] for n, row in enumerate(rows)),
        ";", comma=True, encoding="utf-8-sig", end="\r\n",
    )  # fmt: skip
    write(
        folder / "GPS.csv",
        "Nr.;Datum;Uhrzeit;Breite;Länge;Höhe über Ellipsoid [m];Geschwindigkeit [km/h];Kurs [°]",
        ([str(n + 1), *row] for n, row in enumerate(fix_rows(of, when))),
        ";", comma=True, encoding="utf-8-sig", end="\r\n",
    )  # fmt: skip
    return of


def german_tempo(folder: Path) -> Truth:
    """Tempo is a speed in German."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "fahrt.csv",
        "Zeitstempel;Breitengrad;Längengrad;Tempo [km/h];Heading [°]",
        fix_rows(of, iso, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def german_tempo_bare(folder: Path) -> Truth:
    """Tempo without a unit, beside a time of the day and a date; latin-1."""
    of = truth()
    en_imu(folder, of)

    def when(t: float) -> list[str]:
        return [stamp("%d.%m.%Y %H:%M:%S.%L", t)]

    write(
        folder / "fahrt.csv",
        "Tempo;Zeit;Breite;Länge;Fahrtrichtung",
        ([row[3], row[0], row[1], row[2], row[4]] for row in fix_rows(of, when, height=None)),
        ";", encoding="latin-1",
    )  # fmt: skip
    return of


def french_utf16(folder: Path) -> Truth:
    """UTF-16 with tabs, day first, decimal commas in the times too; cap is the course."""
    of = truth(45.76, 4.84)

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y %H:%M:%S,%L", t)]

    write(
        folder / "centrale.txt",
        "Horodatage\tVitesse angulaire X (°/s)\tVitesse angulaire Y (°/s)\t"
        "Vitesse angulaire Z (°/s)\tAccélération X (g)\tAccélération Y (g)\tAccélération Z (g)",
        imu_rows(of, when, DEG, PER_G),
        "\t", comma=True, encoding="utf-16", end="\r\n",
    )  # fmt: skip
    write(
        folder / "position.txt",
        "Horodatage\tLatitude\tLongitude\tAltitude ellipsoïdale (m)\tVitesse (km/h)\tCap (°)",
        fix_rows(of, when),
        "\t", comma=True, encoding="utf-16", end="\r\n",
    )  # fmt: skip
    return of


def spanish_units_below(folder: Path) -> Truth:
    """Units in a second header row; rumbo is the course."""
    of = truth(40.42, -3.7)
    write(
        folder / "imu.txt",
        "Tiempo;Velocidad angular X;Velocidad angular Y;Velocidad angular Z;Aceleración X;"
        "Aceleración Y;Aceleración Z\ns;grados/s;grados/s;grados/s;m/s2;m/s2;m/s2",
        imu_rows(of, seconds, DEG, 1.0),
        ";", comma=True,
    )  # fmt: skip
    write(
        folder / "gps.txt",
        "Tiempo;Latitud;Longitud;Altura elipsoidal;Velocidad;Rumbo\ns;grados;grados;m;km/h;grados",
        fix_rows(of, seconds),
        ";", comma=True,
    )  # fmt: skip
    return of


def italian(folder: Path) -> Truth:
    """Tempo is a time in Italian; knots, rotta."""
    of = truth(45.07, 7.69)
    write(
        folder / "sensori.csv",
        "Tempo (ms);Giroscopio X (°/s);Giroscopio Y (°/s);Giroscopio Z (°/s);"
        "Accelerazione X (mg);Accelerazione Y (mg);Accelerazione Z (mg)",
        imu_rows(of, lambda t: [f"{1e3 * t:.0f}"], DEG, 1e3 * PER_G),
        ";", comma=True,
    )  # fmt: skip
    write(
        folder / "posizione.csv",
        "Tempo;Latitudine;Longitudine;Velocità (nodi);Rotta (gradi)",
        fix_rows(of, seconds, speed=3600 / 1852, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def portuguese(folder: Path) -> Truth:
    """Data and hora, rumo and velocidade."""
    of = truth(38.72, -9.14)

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y", t), stamp("%H:%M:%S.%L", t)]

    write(
        folder / "sensores.csv",
        "Data;Hora;Giroscópio X (°/s);Giroscópio Y (°/s);Giroscópio Z (°/s);Aceleração X (m/s²);"
        "Aceleração Y (m/s²);Aceleração Z (m/s²)",
        imu_rows(of, when, DEG, 1.0),
        ";",
    )
    write(
        folder / "gps.csv",
        "Data;Hora;Latitude;Longitude;Velocidade (km/h);Rumo (°)",
        fix_rows(of, when, height=None),
        ";",
    )
    return of


def dutch(folder: Path) -> Truth:
    """Tijd, snelheid, koers; a zone in the times."""
    of = truth(52.37, 4.9)

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S.%L+02:00", t, 2.0)]

    write(
        folder / "meting.csv",
        "Tijdstempel,Hoeksnelheid X [rad/s],Hoeksnelheid Y [rad/s],Hoeksnelheid Z [rad/s],"
        "Versnelling X [m/s²],Versnelling Y [m/s²],Versnelling Z [m/s²]",
        imu_rows(of, when),
    )
    write(
        folder / "positie.csv",
        "Tijdstempel,Breedtegraad,Lengtegraad,Snelheid [km/u],Koers [°]",
        fix_rows(of, when, height=None),
    )
    return of


def american(folder: Path) -> Truth:
    """Month first, a 12-hour clock, mph, feet, heading."""
    of = truth(30.33, -97.76)

    def when(t: float) -> list[str]:
        return [stamp("%m/%d/%Y %I:%M:%S.%L %p", t)]

    write(
        folder / "imu_export.csv",
        "Date/Time,Gyro X (dps),Gyro Y (dps),Gyro Z (dps),Accel X (g),Accel Y (g),Accel Z (g)",
        imu_rows(of, when, DEG, PER_G),
    )
    write(
        folder / "gps_export.csv",
        "Date/Time,Latitude,Longitude,Altitude HAE (ft),Speed (mph),Heading",
        fix_rows(of, when, speed=1 / 0.44704, height=1 / 0.3048),
    )
    return of


def thousands(folder: Path) -> Truth:
    """Thousands separators: heights and readings of mg in quotes."""
    of = truth()

    def grouped(text: str, digits: int) -> str:
        return f'"{float(text):,.{digits}f}"'

    rows = imu_rows(of, iso, DEG, 1e3 * PER_G)
    write(
        folder / "imu_log.csv",
        EN_IMU.replace("(g)", "(mg)"),
        ([*row[:4], *(grouped(cell, 4) for cell in row[4:])] for row in rows),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,height [ft],speed [m/s],course",
        (
            [*row[:3], grouped(row[3], 3), *row[4:]]
            for row in fix_rows(of, iso, height=1 / 0.3048, speed=1.0)
        ),
    )
    return of


def german_thousands(folder: Path) -> Truth:
    """1.234,56: points part the thousands where commas are decimal."""
    of = truth()

    def grouped(text: str) -> str:
        return f"{float(text):,.3f}".replace(",", " ").replace(".", ",").replace(" ", ".")

    rows = imu_rows(of, iso, DEG, 1e3 * PER_G)
    write(
        folder / "imu_log.csv",
        "Zeit;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s];Beschl. X [mg];Beschl. Y [mg];"
        "Beschl. Z [mg]",
        ([row[0], *(cell.replace(".", ",") for cell in row[1:4]), *map(grouped, row[4:])]
         for row in rows),
        ";",
    )  # fmt: skip
    write(
        folder / "gps.csv",
        "Zeit;Breite;Länge;Geschwindigkeit [km/h];Kurs",
        fix_rows(of, iso, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


WRITERS = (
    german_excel,
    german_tempo,
    german_tempo_bare,
    french_utf16,
    spanish_units_below,
    italian,
    portuguese,
    dutch,
    american,
    thousands,
    german_thousands,
)
