"""Time limits of a run's processes, all of them, in wall time [s]; a test asserts their order.

The limits of one process outlast those it waits for: a node that fails ends by itself before its supervisor
kills it, and a dead node is named before a tick takes too long.
"""

# A node, between messages

GRANTED_S = 0.2
"""Time that the ticks granted ahead may take: a pause or a stop takes effect after them."""

FAULT_S = 0.5
"""Time for the batches with all ticks that a faulty node had finished to reach the coupler."""

BATCH_S = 0.05
"""Time after which a message is kept for a batch no longer than to the next tick, poll or heartbeat."""

POLL_S = 0.1
"""Interval of checks that no message triggers: matched endpoints, stop requests, silence."""

WAITING_S = 1.0
"""Shortest time between two lines of the log on what a starting node waits for. Nodes that are started
together find each other in about that time, and so log little."""

DIAGNOSTICS_S = 1.0
"""Interval of messages on /diagnostics."""

STALE_S = 1.0
"""Time without a new pose after which a soil that follows warns: ten poses of a camera."""

PROGRESS_S = 10.0
"""Time between two lines of the log about progress: six a minute, so a run of hours can be followed."""

# Heartbeats

HEARTBEAT_S = 0.4

SILENCE_S = 2.5
"""Silence after which a node counts as dead, if its process was on this machine and has ended."""

STALL_S = 10.0
"""The same if its process lives, or is on another machine: it may lack processor time, compile, or be
stopped."""

STARTUP_S = 300.0
"""Time limit until all nodes are ready: engines may have to be compiled."""

DEADLINE_S = 60.0
"""Smallest time limit of a tick: kernels that a later tick needs may have to be compiled."""

# The end of a node

LAST_WORD_S = 1.5
"""Time limit for a last message to arrive; it passes in full if a receiver is dead."""

END_WORD_S = 10.0
"""Time for the status ENDED of the coupler to reach every node."""

CUT_S = 2.0
"""After an abort, time for messages of the last finished tick to reach the recorder."""

KEEP_S = 5.0
"""Time for a run that is interrupted to write a checkpoint; 130,000 particles take about 1 s."""

RETURN_S = 2.0
"""Time for a computing engine to return, so that the node ends in order; then the process ends itself."""

CLOSE_S = 5.0
"""Time to destroy the endpoints of a node: it takes tens of milliseconds."""

LATE_S = 30.0
"""Longest time that a failed coupler publishes its fault for nodes that are still starting. A node that
starts later waits for STARTUP_S; a longer time would delay the end of the coupler's process, which under a
supervisor waits less."""

# The supervisor, and the launch

VERDICT_S = 2.0
"""Time for the coupler to report why the run failed, after a node ended with an error."""

CUT_PATIENCE_S = 2.5
"""Time for the recorder to complete the tick at which the coupler cut the record."""

FAILED_END_S = 4.5
"""Time for the nodes to end by themselves once the run has failed; then they are killed."""

END_S = 10.0
"""The same once the run is over. The recorder waits for the disk, which takes some seconds if it is busy."""

STARTUP_GRACE_S = 20.0
"""The same for nodes that may still be starting and have not read the stop request."""

LAUNCH_PATIENCE_S = 15.0
"""Time for the other nodes of a launch to end after one has failed."""
