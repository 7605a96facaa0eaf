"""From a video to a recording of the body's shape."""

from pliant.video.track import Tracking, track_video

__all__ = ["Tracking", "track_video"]
