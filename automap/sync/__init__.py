"""Host clock to GPS time: from arrival times, by declaration, or by comparing motions."""
