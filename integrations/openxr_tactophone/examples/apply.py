"""Vibrate through an OpenXR runtime: ``python apply.py``, with pyopenxr and PyOpenGL.

Makes a headless session (``XR_MND_headless``), half a second of commands, and applies
their frames by ``xrApplyHapticFeedback``, one each 20 ms. An application has a session
and an action of its own; what it takes from here is `vibration`.
"""

import time

import xr
from openxr_tactophone import Frame, HapticStream

from tactophone import HapticCommand

FRAME = 0.02
"""Seconds of a frame."""


def vibration(frame: Frame) -> xr.HapticParametricVibrationEXT:
    point = xr.HapticParametricPointEXT
    kind = xr.HapticParametricStreamFrameTypeEXT(int(frame.type))
    return xr.HapticParametricVibrationEXT(
        amplitude_points=[point(*each) for each in frame.amplitude_points],
        frequency_points=[point(*each) for each in frame.frequency_points],
        min_frequency_hz=frame.min_frequency_hz,
        max_frequency_hz=frame.max_frequency_hz,
        stream_frame_type=kind,
    )


def main() -> None:
    wanted = ["XR_MND_headless", xr.EXT_HAPTIC_PARAMETRIC_EXTENSION_NAME]
    program = xr.ApplicationInfo("tactophone", api_version=xr.Version(1, 1, 0))
    instance = xr.create_instance(
        xr.InstanceCreateInfo(application_info=program, enabled_extension_names=wanted)
    )
    form = xr.SystemGetInfo(xr.FormFactor.HEAD_MOUNTED_DISPLAY)
    system = xr.get_system(instance, form)
    session = xr.create_session(instance, xr.SessionCreateInfo(system_id=system))
    touch = xr.create_action_set(
        instance, xr.ActionSetCreateInfo("touch", "What the fingertip feels")
    )
    vibrate = xr.create_action(
        touch,
        xr.ActionCreateInfo(
            "vibrate",
            xr.ActionType.VIBRATION_OUTPUT,
            localized_action_name="Vibrate",
        ),
    )
    attached = xr.SessionActionSetsAttachInfo(action_sets=[touch])
    xr.attach_session_action_sets(session, attached)
    action = xr.HapticActionInfo(vibrate)
    stream = HapticStream()
    for number in range(25):
        begin = number * FRAME
        # Rough, then smooth, as the paper's profile has them.
        hertz = 60.0 if number < 12 else 120.0
        command = HapticCommand(0.5, hertz, begin + 0.01)
        frame = stream.frame([command], begin, begin + FRAME)
        xr.apply_haptic_feedback(session, action, vibration(frame))
        time.sleep(FRAME)
    xr.apply_haptic_feedback(session, action, vibration(stream.finish()))
    xr.destroy_session(session)
    xr.destroy_instance(instance)


if __name__ == "__main__":
    main()
