from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Reason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REASON_UNSPECIFIED: _ClassVar[Reason]
    REASON_NOT_READY: _ClassVar[Reason]
    REASON_NOT_FOUND: _ClassVar[Reason]
    REASON_NOT_LOCKED: _ClassVar[Reason]
    REASON_BEAM_BROKEN: _ClassVar[Reason]
    REASON_OUT_OF_RANGE: _ClassVar[Reason]
    REASON_TIMED_OUT: _ClassVar[Reason]
    REASON_BUSY: _ClassVar[Reason]
    REASON_FAULT: _ClassVar[Reason]
REASON_UNSPECIFIED: Reason
REASON_NOT_READY: Reason
REASON_NOT_FOUND: Reason
REASON_NOT_LOCKED: Reason
REASON_BEAM_BROKEN: Reason
REASON_OUT_OF_RANGE: Reason
REASON_TIMED_OUT: Reason
REASON_BUSY: Reason
REASON_FAULT: Reason

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Symmetric3(_message.Message):
    __slots__ = ("xx", "xy", "xz", "yy", "yz", "zz")
    XX_FIELD_NUMBER: _ClassVar[int]
    XY_FIELD_NUMBER: _ClassVar[int]
    XZ_FIELD_NUMBER: _ClassVar[int]
    YY_FIELD_NUMBER: _ClassVar[int]
    YZ_FIELD_NUMBER: _ClassVar[int]
    ZZ_FIELD_NUMBER: _ClassVar[int]
    xx: float
    xy: float
    xz: float
    yy: float
    yz: float
    zz: float
    def __init__(self, xx: _Optional[float] = ..., xy: _Optional[float] = ..., xz: _Optional[float] = ..., yy: _Optional[float] = ..., yz: _Optional[float] = ..., zz: _Optional[float] = ...) -> None: ...

class Target(_message.Message):
    __slots__ = ("position_m", "direction")
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    position_m: Vector3
    direction: Vector3
    def __init__(self, position_m: _Optional[_Union[Vector3, _Mapping]] = ..., direction: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class StatusRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Status(_message.Message):
    __slots__ = ("ready", "busy", "beam_locked", "beam_lost", "message", "range_m", "on_time_s", "warming_up", "expected_drift_m", "temperature_c", "max_speed_m_s", "model", "serial_number", "time_ns")
    READY_FIELD_NUMBER: _ClassVar[int]
    BUSY_FIELD_NUMBER: _ClassVar[int]
    BEAM_LOCKED_FIELD_NUMBER: _ClassVar[int]
    BEAM_LOST_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    RANGE_M_FIELD_NUMBER: _ClassVar[int]
    ON_TIME_S_FIELD_NUMBER: _ClassVar[int]
    WARMING_UP_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_DRIFT_M_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    MAX_SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    SERIAL_NUMBER_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    ready: bool
    busy: bool
    beam_locked: bool
    beam_lost: Reason
    message: str
    range_m: float
    on_time_s: float
    warming_up: bool
    expected_drift_m: float
    temperature_c: float
    max_speed_m_s: float
    model: str
    serial_number: str
    time_ns: int
    def __init__(self, ready: _Optional[bool] = ..., busy: _Optional[bool] = ..., beam_locked: _Optional[bool] = ..., beam_lost: _Optional[_Union[Reason, str]] = ..., message: _Optional[str] = ..., range_m: _Optional[float] = ..., on_time_s: _Optional[float] = ..., warming_up: _Optional[bool] = ..., expected_drift_m: _Optional[float] = ..., temperature_c: _Optional[float] = ..., max_speed_m_s: _Optional[float] = ..., model: _Optional[str] = ..., serial_number: _Optional[str] = ..., time_ns: _Optional[int] = ...) -> None: ...

class AimRequest(_message.Message):
    __slots__ = ("target", "search_radius_m")
    TARGET_FIELD_NUMBER: _ClassVar[int]
    SEARCH_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    target: Target
    search_radius_m: float
    def __init__(self, target: _Optional[_Union[Target, _Mapping]] = ..., search_radius_m: _Optional[float] = ...) -> None: ...

class SearchRequest(_message.Message):
    __slots__ = ("target", "search_radius_m")
    TARGET_FIELD_NUMBER: _ClassVar[int]
    SEARCH_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    target: Target
    search_radius_m: float
    def __init__(self, target: _Optional[_Union[Target, _Mapping]] = ..., search_radius_m: _Optional[float] = ...) -> None: ...

class BeamReply(_message.Message):
    __slots__ = ("success", "reason", "message", "position_m")
    SUCCESS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    success: bool
    reason: Reason
    message: str
    position_m: Vector3
    def __init__(self, success: _Optional[bool] = ..., reason: _Optional[_Union[Reason, str]] = ..., message: _Optional[str] = ..., position_m: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class MeasureRequest(_message.Message):
    __slots__ = ("averaging_time_s", "rate_hz")
    AVERAGING_TIME_S_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    averaging_time_s: float
    rate_hz: float
    def __init__(self, averaging_time_s: _Optional[float] = ..., rate_hz: _Optional[float] = ...) -> None: ...

class MeasureReply(_message.Message):
    __slots__ = ("success", "reason", "message", "position_m", "covariance_m2", "rms_m", "samples", "averaging_time_s", "temperature_c", "time_ns")
    SUCCESS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_M2_FIELD_NUMBER: _ClassVar[int]
    RMS_M_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    AVERAGING_TIME_S_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    success: bool
    reason: Reason
    message: str
    position_m: Vector3
    covariance_m2: Symmetric3
    rms_m: float
    samples: int
    averaging_time_s: float
    temperature_c: float
    time_ns: int
    def __init__(self, success: _Optional[bool] = ..., reason: _Optional[_Union[Reason, str]] = ..., message: _Optional[str] = ..., position_m: _Optional[_Union[Vector3, _Mapping]] = ..., covariance_m2: _Optional[_Union[Symmetric3, _Mapping]] = ..., rms_m: _Optional[float] = ..., samples: _Optional[int] = ..., averaging_time_s: _Optional[float] = ..., temperature_c: _Optional[float] = ..., time_ns: _Optional[int] = ...) -> None: ...
