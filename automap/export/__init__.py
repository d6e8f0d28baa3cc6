"""Maps for other software: GeoJSON, KML, GeoPackage, GeoParquet."""
