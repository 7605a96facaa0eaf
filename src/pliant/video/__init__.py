"""Track the shape of a soft body in a video and return it as a recording."""

from pliant.video.track import Tracking, track_video

__all__ = ["Tracking", "track_video"]
