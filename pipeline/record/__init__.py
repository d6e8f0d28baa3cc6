"""Recording a drive: serial ports, receivers, inertial sensors, cameras, into a drive folder.

Bytes go to disk as they came, with the host time of their arrival; what the live view needs is
decoded beside that and can fail without harm. A thread for each port does nothing but read and
stamp, one thread writes all files, one syncs them to the disk.

Times are nanoseconds of the host's monotonic clock ("boot_ns" in the manifest).
"""
