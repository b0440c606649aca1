"""Live work with a running motor: sources, logs, tracking, and driving a board.

=============  ========================================================================================================
`protocol`     lines of numbers: header, rows, gaps
`sources`      files, standard input, serial ports, sockets
`log`          an append-only log of everything that is received
`receiver`     a thread that reads a source into the log and for the tracker
`tracking`     recursive estimate, detection of changes, and a fixed model, as values
`session`      a stream of messages from what is received
`board`        a simulated motor that takes commands
`server`       serves it on a TCP port and on a pseudo-terminal
`driving`      drives a board with a test signal, within limits
=============  ========================================================================================================
"""
