from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Cause(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CAUSE_NONE: _ClassVar[Cause]
    CAUSE_NO_MEASUREMENT: _ClassVar[Cause]
    CAUSE_TOO_STEEP: _ClassVar[Cause]
    CAUSE_BAD_ROTATION: _ClassVar[Cause]
    CAUSE_NON_FINITE: _ClassVar[Cause]
    CAUSE_NO_NUMBERS: _ClassVar[Cause]
    CAUSE_MOUNT_ERROR: _ClassVar[Cause]
    CAUSE_MOUNT_UNVERIFIED: _ClassVar[Cause]
    CAUSE_NO_ATTITUDE: _ClassVar[Cause]
    CAUSE_ATTITUDE_STALE: _ClassVar[Cause]
    CAUSE_ATTITUDE_TOO_OLD: _ClassVar[Cause]
    CAUSE_FRAME_TOO_OLD: _ClassVar[Cause]
    CAUSE_GAP_TOO_WIDE: _ClassVar[Cause]
    CAUSE_NO_RATES: _ClassVar[Cause]
    CAUSE_CLOCK_UNCERTAIN: _ClassVar[Cause]
    CAUSE_DUPLICATE_FRAME: _ClassVar[Cause]
    CAUSE_LATE_FRAME: _ClassVar[Cause]
    CAUSE_WRONG_SIZE: _ClassVar[Cause]
    CAUSE_BUSY: _ClassVar[Cause]
    CAUSE_CAMERA: _ClassVar[Cause]
CAUSE_NONE: Cause
CAUSE_NO_MEASUREMENT: Cause
CAUSE_TOO_STEEP: Cause
CAUSE_BAD_ROTATION: Cause
CAUSE_NON_FINITE: Cause
CAUSE_NO_NUMBERS: Cause
CAUSE_MOUNT_ERROR: Cause
CAUSE_MOUNT_UNVERIFIED: Cause
CAUSE_NO_ATTITUDE: Cause
CAUSE_ATTITUDE_STALE: Cause
CAUSE_ATTITUDE_TOO_OLD: Cause
CAUSE_FRAME_TOO_OLD: Cause
CAUSE_GAP_TOO_WIDE: Cause
CAUSE_NO_RATES: Cause
CAUSE_CLOCK_UNCERTAIN: Cause
CAUSE_DUPLICATE_FRAME: Cause
CAUSE_LATE_FRAME: Cause
CAUSE_WRONG_SIZE: Cause
CAUSE_BUSY: Cause
CAUSE_CAMERA: Cause

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Quaternion(_message.Message):
    __slots__ = ("w", "x", "y", "z")
    W_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    w: float
    x: float
    y: float
    z: float
    def __init__(self, w: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class AttitudeSample(_message.Message):
    __slots__ = ("t_ns", "t_arrival_ns", "q_ned_frd", "rates_frd_rad_s", "stamp_error_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    T_ARRIVAL_NS_FIELD_NUMBER: _ClassVar[int]
    Q_NED_FRD_FIELD_NUMBER: _ClassVar[int]
    RATES_FRD_RAD_S_FIELD_NUMBER: _ClassVar[int]
    STAMP_ERROR_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    t_arrival_ns: int
    q_ned_frd: Quaternion
    rates_frd_rad_s: Vector3
    stamp_error_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., t_arrival_ns: _Optional[int] = ..., q_ned_frd: _Optional[_Union[Quaternion, _Mapping]] = ..., rates_frd_rad_s: _Optional[_Union[Vector3, _Mapping]] = ..., stamp_error_ns: _Optional[int] = ...) -> None: ...

class PoseSample(_message.Message):
    __slots__ = ("t_ns", "t_arrival_ns", "position_ned_m", "velocity_ned_m_s", "reset_counter", "stamp_error_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    T_ARRIVAL_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_NED_M_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_NED_M_S_FIELD_NUMBER: _ClassVar[int]
    RESET_COUNTER_FIELD_NUMBER: _ClassVar[int]
    STAMP_ERROR_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    t_arrival_ns: int
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    reset_counter: int
    stamp_error_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., t_arrival_ns: _Optional[int] = ..., position_ned_m: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_ned_m_s: _Optional[_Union[Vector3, _Mapping]] = ..., reset_counter: _Optional[int] = ..., stamp_error_ns: _Optional[int] = ...) -> None: ...

class CameraInfo(_message.Message):
    __slots__ = ("camera", "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "mount_roll_rad", "mount_pitch_rad", "mount_yaw_rad", "lever_arm_frd_m", "min_range_m", "max_range_m", "ke_per_m", "marks_smooth", "bias_per_m")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    FX_PX_FIELD_NUMBER: _ClassVar[int]
    FY_PX_FIELD_NUMBER: _ClassVar[int]
    CX_PX_FIELD_NUMBER: _ClassVar[int]
    CY_PX_FIELD_NUMBER: _ClassVar[int]
    MOUNT_ROLL_RAD_FIELD_NUMBER: _ClassVar[int]
    MOUNT_PITCH_RAD_FIELD_NUMBER: _ClassVar[int]
    MOUNT_YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    LEVER_ARM_FRD_M_FIELD_NUMBER: _ClassVar[int]
    MIN_RANGE_M_FIELD_NUMBER: _ClassVar[int]
    MAX_RANGE_M_FIELD_NUMBER: _ClassVar[int]
    KE_PER_M_FIELD_NUMBER: _ClassVar[int]
    MARKS_SMOOTH_FIELD_NUMBER: _ClassVar[int]
    BIAS_PER_M_FIELD_NUMBER: _ClassVar[int]
    camera: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    mount_roll_rad: float
    mount_pitch_rad: float
    mount_yaw_rad: float
    lever_arm_frd_m: Vector3
    min_range_m: float
    max_range_m: float
    ke_per_m: float
    marks_smooth: bool
    bias_per_m: float
    def __init__(self, camera: _Optional[str] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., fx_px: _Optional[float] = ..., fy_px: _Optional[float] = ..., cx_px: _Optional[float] = ..., cy_px: _Optional[float] = ..., mount_roll_rad: _Optional[float] = ..., mount_pitch_rad: _Optional[float] = ..., mount_yaw_rad: _Optional[float] = ..., lever_arm_frd_m: _Optional[_Union[Vector3, _Mapping]] = ..., min_range_m: _Optional[float] = ..., max_range_m: _Optional[float] = ..., ke_per_m: _Optional[float] = ..., marks_smooth: bool = ..., bias_per_m: _Optional[float] = ...) -> None: ...

class AttitudeUsed(_message.Message):
    __slots__ = ("source", "q_ned_frd", "distance_ns")
    class Source(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        SOURCE_NONE: _ClassVar[AttitudeUsed.Source]
        SOURCE_EXACT: _ClassVar[AttitudeUsed.Source]
        SOURCE_INTERPOLATED: _ClassVar[AttitudeUsed.Source]
        SOURCE_EXTRAPOLATED: _ClassVar[AttitudeUsed.Source]
    SOURCE_NONE: AttitudeUsed.Source
    SOURCE_EXACT: AttitudeUsed.Source
    SOURCE_INTERPOLATED: AttitudeUsed.Source
    SOURCE_EXTRAPOLATED: AttitudeUsed.Source
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    Q_NED_FRD_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_NS_FIELD_NUMBER: _ClassVar[int]
    source: AttitudeUsed.Source
    q_ned_frd: Quaternion
    distance_ns: int
    def __init__(self, source: _Optional[_Union[AttitudeUsed.Source, str]] = ..., q_ned_frd: _Optional[_Union[Quaternion, _Mapping]] = ..., distance_ns: _Optional[int] = ...) -> None: ...

class PoseUsed(_message.Message):
    __slots__ = ("source", "position_ned_m", "distance_ns", "reset_counter")
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    POSITION_NED_M_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_NS_FIELD_NUMBER: _ClassVar[int]
    RESET_COUNTER_FIELD_NUMBER: _ClassVar[int]
    source: AttitudeUsed.Source
    position_ned_m: Vector3
    distance_ns: int
    reset_counter: int
    def __init__(self, source: _Optional[_Union[AttitudeUsed.Source, str]] = ..., position_ned_m: _Optional[_Union[Vector3, _Mapping]] = ..., distance_ns: _Optional[int] = ..., reset_counter: _Optional[int] = ...) -> None: ...

class LevelTransform(_message.Message):
    __slots__ = ("yaw_rad", "translation_m")
    YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    TRANSLATION_M_FIELD_NUMBER: _ClassVar[int]
    yaw_rad: float
    translation_m: Vector3
    def __init__(self, yaw_rad: _Optional[float] = ..., translation_m: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Planes(_message.Message):
    __slots__ = ("corners_m", "margin_m", "support_px", "flags", "cluster")
    CORNERS_M_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    SUPPORT_PX_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    CLUSTER_FIELD_NUMBER: _ClassVar[int]
    corners_m: _containers.RepeatedScalarFieldContainer[float]
    margin_m: _containers.RepeatedScalarFieldContainer[float]
    support_px: _containers.RepeatedScalarFieldContainer[int]
    flags: _containers.RepeatedScalarFieldContainer[int]
    cluster: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, corners_m: _Optional[_Iterable[float]] = ..., margin_m: _Optional[_Iterable[float]] = ..., support_px: _Optional[_Iterable[int]] = ..., flags: _Optional[_Iterable[int]] = ..., cluster: _Optional[_Iterable[int]] = ...) -> None: ...

class Prism(_message.Message):
    __slots__ = ("cluster", "top_m", "bottom_m", "closed", "margin_m", "vertices_m", "plane")
    CLUSTER_FIELD_NUMBER: _ClassVar[int]
    TOP_M_FIELD_NUMBER: _ClassVar[int]
    BOTTOM_M_FIELD_NUMBER: _ClassVar[int]
    CLOSED_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    VERTICES_M_FIELD_NUMBER: _ClassVar[int]
    PLANE_FIELD_NUMBER: _ClassVar[int]
    cluster: int
    top_m: float
    bottom_m: float
    closed: bool
    margin_m: float
    vertices_m: _containers.RepeatedScalarFieldContainer[float]
    plane: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, cluster: _Optional[int] = ..., top_m: _Optional[float] = ..., bottom_m: _Optional[float] = ..., closed: bool = ..., margin_m: _Optional[float] = ..., vertices_m: _Optional[_Iterable[float]] = ..., plane: _Optional[_Iterable[int]] = ...) -> None: ...

class FreeProfile(_message.Message):
    __slots__ = ("azimuth_edges_rad", "layer_edges_m", "free_from_m", "free_to_m", "end", "open_from_dm", "open_to_dm")
    AZIMUTH_EDGES_RAD_FIELD_NUMBER: _ClassVar[int]
    LAYER_EDGES_M_FIELD_NUMBER: _ClassVar[int]
    FREE_FROM_M_FIELD_NUMBER: _ClassVar[int]
    FREE_TO_M_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    OPEN_FROM_DM_FIELD_NUMBER: _ClassVar[int]
    OPEN_TO_DM_FIELD_NUMBER: _ClassVar[int]
    azimuth_edges_rad: _containers.RepeatedScalarFieldContainer[float]
    layer_edges_m: _containers.RepeatedScalarFieldContainer[float]
    free_from_m: _containers.RepeatedScalarFieldContainer[float]
    free_to_m: _containers.RepeatedScalarFieldContainer[float]
    end: bytes
    open_from_dm: bytes
    open_to_dm: bytes
    def __init__(self, azimuth_edges_rad: _Optional[_Iterable[float]] = ..., layer_edges_m: _Optional[_Iterable[float]] = ..., free_from_m: _Optional[_Iterable[float]] = ..., free_to_m: _Optional[_Iterable[float]] = ..., end: _Optional[bytes] = ..., open_from_dm: _Optional[bytes] = ..., open_to_dm: _Optional[bytes] = ...) -> None: ...

class Ground(_message.Message):
    __slots__ = ("seen", "height_m", "slope_x", "slope_y", "share", "blind_beyond_m", "tolerance_m", "noise_per_m", "seen_from_m", "seen_to_m")
    SEEN_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    SLOPE_X_FIELD_NUMBER: _ClassVar[int]
    SLOPE_Y_FIELD_NUMBER: _ClassVar[int]
    SHARE_FIELD_NUMBER: _ClassVar[int]
    BLIND_BEYOND_M_FIELD_NUMBER: _ClassVar[int]
    TOLERANCE_M_FIELD_NUMBER: _ClassVar[int]
    NOISE_PER_M_FIELD_NUMBER: _ClassVar[int]
    SEEN_FROM_M_FIELD_NUMBER: _ClassVar[int]
    SEEN_TO_M_FIELD_NUMBER: _ClassVar[int]
    seen: bool
    height_m: float
    slope_x: float
    slope_y: float
    share: float
    blind_beyond_m: float
    tolerance_m: float
    noise_per_m: float
    seen_from_m: _containers.RepeatedScalarFieldContainer[float]
    seen_to_m: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, seen: bool = ..., height_m: _Optional[float] = ..., slope_x: _Optional[float] = ..., slope_y: _Optional[float] = ..., share: _Optional[float] = ..., blind_beyond_m: _Optional[float] = ..., tolerance_m: _Optional[float] = ..., noise_per_m: _Optional[float] = ..., seen_from_m: _Optional[_Iterable[float]] = ..., seen_to_m: _Optional[_Iterable[float]] = ...) -> None: ...

class FrameStats(_message.Message):
    __slots__ = ("measured_share", "unknown_share", "far_share", "flying_px", "ground_px", "strips", "dropped_strips", "clusters", "planes", "prisms", "overflow", "smeared_px")
    MEASURED_SHARE_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_SHARE_FIELD_NUMBER: _ClassVar[int]
    FAR_SHARE_FIELD_NUMBER: _ClassVar[int]
    FLYING_PX_FIELD_NUMBER: _ClassVar[int]
    GROUND_PX_FIELD_NUMBER: _ClassVar[int]
    STRIPS_FIELD_NUMBER: _ClassVar[int]
    DROPPED_STRIPS_FIELD_NUMBER: _ClassVar[int]
    CLUSTERS_FIELD_NUMBER: _ClassVar[int]
    PLANES_FIELD_NUMBER: _ClassVar[int]
    PRISMS_FIELD_NUMBER: _ClassVar[int]
    OVERFLOW_FIELD_NUMBER: _ClassVar[int]
    SMEARED_PX_FIELD_NUMBER: _ClassVar[int]
    measured_share: float
    unknown_share: float
    far_share: float
    flying_px: int
    ground_px: int
    strips: int
    dropped_strips: int
    clusters: int
    planes: int
    prisms: int
    overflow: int
    smeared_px: int
    def __init__(self, measured_share: _Optional[float] = ..., unknown_share: _Optional[float] = ..., far_share: _Optional[float] = ..., flying_px: _Optional[int] = ..., ground_px: _Optional[int] = ..., strips: _Optional[int] = ..., dropped_strips: _Optional[int] = ..., clusters: _Optional[int] = ..., planes: _Optional[int] = ..., prisms: _Optional[int] = ..., overflow: _Optional[int] = ..., smeared_px: _Optional[int] = ...) -> None: ...

class Publication(_message.Message):
    __slots__ = ("boot_id", "number", "age_ns", "suspended_ns", "start_ns")
    BOOT_ID_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    AGE_NS_FIELD_NUMBER: _ClassVar[int]
    SUSPENDED_NS_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    boot_id: str
    number: int
    age_ns: int
    suspended_ns: int
    start_ns: int
    def __init__(self, boot_id: _Optional[str] = ..., number: _Optional[int] = ..., age_ns: _Optional[int] = ..., suspended_ns: _Optional[int] = ..., start_ns: _Optional[int] = ...) -> None: ...

class PrismsFrame(_message.Message):
    __slots__ = ("schema_version", "camera", "sequence", "t_exposure_ns", "frame", "valid", "cause", "cause_text", "planes", "prisms", "free", "ground", "stats", "ke_per_m", "attitude", "pose", "transform", "publication")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    T_EXPOSURE_NS_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    VALID_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    CAUSE_TEXT_FIELD_NUMBER: _ClassVar[int]
    PLANES_FIELD_NUMBER: _ClassVar[int]
    PRISMS_FIELD_NUMBER: _ClassVar[int]
    FREE_FIELD_NUMBER: _ClassVar[int]
    GROUND_FIELD_NUMBER: _ClassVar[int]
    STATS_FIELD_NUMBER: _ClassVar[int]
    KE_PER_M_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    TRANSFORM_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    camera: str
    sequence: int
    t_exposure_ns: int
    frame: str
    valid: bool
    cause: Cause
    cause_text: str
    planes: Planes
    prisms: _containers.RepeatedCompositeFieldContainer[Prism]
    free: FreeProfile
    ground: Ground
    stats: FrameStats
    ke_per_m: float
    attitude: AttitudeUsed
    pose: PoseUsed
    transform: LevelTransform
    publication: Publication
    def __init__(self, schema_version: _Optional[int] = ..., camera: _Optional[str] = ..., sequence: _Optional[int] = ..., t_exposure_ns: _Optional[int] = ..., frame: _Optional[str] = ..., valid: bool = ..., cause: _Optional[_Union[Cause, str]] = ..., cause_text: _Optional[str] = ..., planes: _Optional[_Union[Planes, _Mapping]] = ..., prisms: _Optional[_Iterable[_Union[Prism, _Mapping]]] = ..., free: _Optional[_Union[FreeProfile, _Mapping]] = ..., ground: _Optional[_Union[Ground, _Mapping]] = ..., stats: _Optional[_Union[FrameStats, _Mapping]] = ..., ke_per_m: _Optional[float] = ..., attitude: _Optional[_Union[AttitudeUsed, _Mapping]] = ..., pose: _Optional[_Union[PoseUsed, _Mapping]] = ..., transform: _Optional[_Union[LevelTransform, _Mapping]] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ...) -> None: ...

class Tracks(_message.Message):
    __slots__ = ("schema_version", "camera", "sequence", "t_exposure_ns", "frame", "valid", "cause", "id", "corners_m", "margin_m", "sigma_m", "confidence", "state", "hits", "age_ns", "unseen_ns", "flags", "object_id", "objects", "publication", "left_out", "evicted")
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STATE_UNKNOWN: _ClassVar[Tracks.State]
        STATE_NEW: _ClassVar[Tracks.State]
        STATE_DETECTED: _ClassVar[Tracks.State]
        STATE_MISSED: _ClassVar[Tracks.State]
        STATE_HIDDEN: _ClassVar[Tracks.State]
        STATE_OUT_OF_VIEW: _ClassVar[Tracks.State]
    STATE_UNKNOWN: Tracks.State
    STATE_NEW: Tracks.State
    STATE_DETECTED: Tracks.State
    STATE_MISSED: Tracks.State
    STATE_HIDDEN: Tracks.State
    STATE_OUT_OF_VIEW: Tracks.State
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    T_EXPOSURE_NS_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    VALID_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    CORNERS_M_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    SIGMA_M_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    HITS_FIELD_NUMBER: _ClassVar[int]
    AGE_NS_FIELD_NUMBER: _ClassVar[int]
    UNSEEN_NS_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    EVICTED_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    camera: str
    sequence: int
    t_exposure_ns: int
    frame: str
    valid: bool
    cause: Cause
    id: _containers.RepeatedScalarFieldContainer[int]
    corners_m: _containers.RepeatedScalarFieldContainer[float]
    margin_m: _containers.RepeatedScalarFieldContainer[float]
    sigma_m: _containers.RepeatedScalarFieldContainer[float]
    confidence: _containers.RepeatedScalarFieldContainer[float]
    state: _containers.RepeatedScalarFieldContainer[Tracks.State]
    hits: _containers.RepeatedScalarFieldContainer[int]
    age_ns: _containers.RepeatedScalarFieldContainer[int]
    unseen_ns: _containers.RepeatedScalarFieldContainer[int]
    flags: _containers.RepeatedScalarFieldContainer[int]
    object_id: _containers.RepeatedScalarFieldContainer[int]
    objects: _containers.RepeatedCompositeFieldContainer[MovingObstacle]
    publication: Publication
    left_out: int
    evicted: int
    def __init__(self, schema_version: _Optional[int] = ..., camera: _Optional[str] = ..., sequence: _Optional[int] = ..., t_exposure_ns: _Optional[int] = ..., frame: _Optional[str] = ..., valid: bool = ..., cause: _Optional[_Union[Cause, str]] = ..., id: _Optional[_Iterable[int]] = ..., corners_m: _Optional[_Iterable[float]] = ..., margin_m: _Optional[_Iterable[float]] = ..., sigma_m: _Optional[_Iterable[float]] = ..., confidence: _Optional[_Iterable[float]] = ..., state: _Optional[_Iterable[_Union[Tracks.State, str]]] = ..., hits: _Optional[_Iterable[int]] = ..., age_ns: _Optional[_Iterable[int]] = ..., unseen_ns: _Optional[_Iterable[int]] = ..., flags: _Optional[_Iterable[int]] = ..., object_id: _Optional[_Iterable[int]] = ..., objects: _Optional[_Iterable[_Union[MovingObstacle, _Mapping]]] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ..., left_out: _Optional[int] = ..., evicted: _Optional[int] = ...) -> None: ...

class MovingObstacle(_message.Message):
    __slots__ = ("id", "centre_m", "half_size_m", "velocity_x_m_s", "velocity_y_m_s", "position_sigma_m", "velocity_sigma_m_s", "covariance_m2_s", "hits", "age_ns", "unseen_ns")
    ID_FIELD_NUMBER: _ClassVar[int]
    CENTRE_M_FIELD_NUMBER: _ClassVar[int]
    HALF_SIZE_M_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_X_M_S_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_Y_M_S_FIELD_NUMBER: _ClassVar[int]
    POSITION_SIGMA_M_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_SIGMA_M_S_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_M2_S_FIELD_NUMBER: _ClassVar[int]
    HITS_FIELD_NUMBER: _ClassVar[int]
    AGE_NS_FIELD_NUMBER: _ClassVar[int]
    UNSEEN_NS_FIELD_NUMBER: _ClassVar[int]
    id: int
    centre_m: Vector3
    half_size_m: Vector3
    velocity_x_m_s: float
    velocity_y_m_s: float
    position_sigma_m: float
    velocity_sigma_m_s: float
    covariance_m2_s: float
    hits: int
    age_ns: int
    unseen_ns: int
    def __init__(self, id: _Optional[int] = ..., centre_m: _Optional[_Union[Vector3, _Mapping]] = ..., half_size_m: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_x_m_s: _Optional[float] = ..., velocity_y_m_s: _Optional[float] = ..., position_sigma_m: _Optional[float] = ..., velocity_sigma_m_s: _Optional[float] = ..., covariance_m2_s: _Optional[float] = ..., hits: _Optional[int] = ..., age_ns: _Optional[int] = ..., unseen_ns: _Optional[int] = ...) -> None: ...

class SurroundFrame(_message.Message):
    __slots__ = ("schema_version", "t_ns", "frame", "valid", "cameras", "publication")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    T_NS_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    VALID_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    t_ns: int
    frame: str
    valid: bool
    cameras: _containers.RepeatedCompositeFieldContainer[PrismsFrame]
    publication: Publication
    def __init__(self, schema_version: _Optional[int] = ..., t_ns: _Optional[int] = ..., frame: _Optional[str] = ..., valid: bool = ..., cameras: _Optional[_Iterable[_Union[PrismsFrame, _Mapping]]] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ...) -> None: ...

class FrameDecision(_message.Message):
    __slots__ = ("camera", "sequence", "t_exposure_ns", "t_arrival_ns", "used", "cause", "attitude", "attitude_cutoff_ns", "pose", "pose_text")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    T_EXPOSURE_NS_FIELD_NUMBER: _ClassVar[int]
    T_ARRIVAL_NS_FIELD_NUMBER: _ClassVar[int]
    USED_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_CUTOFF_NS_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    POSE_TEXT_FIELD_NUMBER: _ClassVar[int]
    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    used: bool
    cause: Cause
    attitude: AttitudeUsed.Source
    attitude_cutoff_ns: int
    pose: AttitudeUsed.Source
    pose_text: str
    def __init__(self, camera: _Optional[str] = ..., sequence: _Optional[int] = ..., t_exposure_ns: _Optional[int] = ..., t_arrival_ns: _Optional[int] = ..., used: bool = ..., cause: _Optional[_Union[Cause, str]] = ..., attitude: _Optional[_Union[AttitudeUsed.Source, str]] = ..., attitude_cutoff_ns: _Optional[int] = ..., pose: _Optional[_Union[AttitudeUsed.Source, str]] = ..., pose_text: _Optional[str] = ...) -> None: ...

class CameraState(_message.Message):
    __slots__ = ("camera", "ground_height_m", "ke_per_m", "last_t_exposure_ns", "mount", "still_ke_per_m", "samples_mm", "samples_age", "edge_ramps", "edge_steps", "back_since_ns")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    GROUND_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    KE_PER_M_FIELD_NUMBER: _ClassVar[int]
    LAST_T_EXPOSURE_NS_FIELD_NUMBER: _ClassVar[int]
    MOUNT_FIELD_NUMBER: _ClassVar[int]
    STILL_KE_PER_M_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_MM_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_AGE_FIELD_NUMBER: _ClassVar[int]
    EDGE_RAMPS_FIELD_NUMBER: _ClassVar[int]
    EDGE_STEPS_FIELD_NUMBER: _ClassVar[int]
    BACK_SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    camera: str
    ground_height_m: float
    ke_per_m: float
    last_t_exposure_ns: int
    mount: MountState
    still_ke_per_m: float
    samples_mm: bytes
    samples_age: int
    edge_ramps: float
    edge_steps: float
    back_since_ns: int
    def __init__(self, camera: _Optional[str] = ..., ground_height_m: _Optional[float] = ..., ke_per_m: _Optional[float] = ..., last_t_exposure_ns: _Optional[int] = ..., mount: _Optional[_Union[MountState, _Mapping]] = ..., still_ke_per_m: _Optional[float] = ..., samples_mm: _Optional[bytes] = ..., samples_age: _Optional[int] = ..., edge_ramps: _Optional[float] = ..., edge_steps: _Optional[float] = ..., back_since_ns: _Optional[int] = ...) -> None: ...

class MountState(_message.Message):
    __slots__ = ("t_ns", "measurements", "verdict", "pending", "streak", "slope_rad", "mean", "covariance", "ground", "confirmations", "residual_north_rad", "residual_east_rad", "heading_jump_ns")
    class Verdict(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        VERDICT_UNKNOWN: _ClassVar[MountState.Verdict]
        VERDICT_VERIFIED: _ClassVar[MountState.Verdict]
        VERDICT_DEGRADED: _ClassVar[MountState.Verdict]
        VERDICT_UNVERIFIED_SLOPE: _ClassVar[MountState.Verdict]
        VERDICT_ERROR: _ClassVar[MountState.Verdict]
    VERDICT_UNKNOWN: MountState.Verdict
    VERDICT_VERIFIED: MountState.Verdict
    VERDICT_DEGRADED: MountState.Verdict
    VERDICT_UNVERIFIED_SLOPE: MountState.Verdict
    VERDICT_ERROR: MountState.Verdict
    T_NS_FIELD_NUMBER: _ClassVar[int]
    MEASUREMENTS_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    PENDING_FIELD_NUMBER: _ClassVar[int]
    STREAK_FIELD_NUMBER: _ClassVar[int]
    SLOPE_RAD_FIELD_NUMBER: _ClassVar[int]
    MEAN_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    GROUND_FIELD_NUMBER: _ClassVar[int]
    CONFIRMATIONS_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_NORTH_RAD_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_EAST_RAD_FIELD_NUMBER: _ClassVar[int]
    HEADING_JUMP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    measurements: int
    verdict: MountState.Verdict
    pending: MountState.Verdict
    streak: int
    slope_rad: float
    mean: _containers.RepeatedScalarFieldContainer[float]
    covariance: _containers.RepeatedScalarFieldContainer[float]
    ground: bool
    confirmations: int
    residual_north_rad: float
    residual_east_rad: float
    heading_jump_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., measurements: _Optional[int] = ..., verdict: _Optional[_Union[MountState.Verdict, str]] = ..., pending: _Optional[_Union[MountState.Verdict, str]] = ..., streak: _Optional[int] = ..., slope_rad: _Optional[float] = ..., mean: _Optional[_Iterable[float]] = ..., covariance: _Optional[_Iterable[float]] = ..., ground: bool = ..., confirmations: _Optional[int] = ..., residual_north_rad: _Optional[float] = ..., residual_east_rad: _Optional[float] = ..., heading_jump_ns: _Optional[int] = ...) -> None: ...

class MountHealth(_message.Message):
    __slots__ = ("verdict", "roll_error_deg", "pitch_error_deg", "roll_sd_deg", "pitch_sd_deg", "roll_deg", "pitch_deg", "yaw_deg", "slope_deg", "yaw_error_deg", "yaw_sd_deg")
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    ROLL_ERROR_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_ERROR_DEG_FIELD_NUMBER: _ClassVar[int]
    ROLL_SD_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_SD_DEG_FIELD_NUMBER: _ClassVar[int]
    ROLL_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_DEG_FIELD_NUMBER: _ClassVar[int]
    YAW_DEG_FIELD_NUMBER: _ClassVar[int]
    SLOPE_DEG_FIELD_NUMBER: _ClassVar[int]
    YAW_ERROR_DEG_FIELD_NUMBER: _ClassVar[int]
    YAW_SD_DEG_FIELD_NUMBER: _ClassVar[int]
    verdict: MountState.Verdict
    roll_error_deg: float
    pitch_error_deg: float
    roll_sd_deg: float
    pitch_sd_deg: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    slope_deg: float
    yaw_error_deg: float
    yaw_sd_deg: float
    def __init__(self, verdict: _Optional[_Union[MountState.Verdict, str]] = ..., roll_error_deg: _Optional[float] = ..., pitch_error_deg: _Optional[float] = ..., roll_sd_deg: _Optional[float] = ..., pitch_sd_deg: _Optional[float] = ..., roll_deg: _Optional[float] = ..., pitch_deg: _Optional[float] = ..., yaw_deg: _Optional[float] = ..., slope_deg: _Optional[float] = ..., yaw_error_deg: _Optional[float] = ..., yaw_sd_deg: _Optional[float] = ...) -> None: ...

class StateSnapshot(_message.Message):
    __slots__ = ("cameras", "attitudes", "poses", "trackers", "headings", "sections")
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    ATTITUDES_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    TRACKERS_FIELD_NUMBER: _ClassVar[int]
    HEADINGS_FIELD_NUMBER: _ClassVar[int]
    SECTIONS_FIELD_NUMBER: _ClassVar[int]
    cameras: _containers.RepeatedCompositeFieldContainer[CameraState]
    attitudes: _containers.RepeatedCompositeFieldContainer[AttitudeSample]
    poses: _containers.RepeatedCompositeFieldContainer[PoseSample]
    trackers: _containers.RepeatedCompositeFieldContainer[TrackerState]
    headings: HeadingState
    sections: PositionState
    def __init__(self, cameras: _Optional[_Iterable[_Union[CameraState, _Mapping]]] = ..., attitudes: _Optional[_Iterable[_Union[AttitudeSample, _Mapping]]] = ..., poses: _Optional[_Iterable[_Union[PoseSample, _Mapping]]] = ..., trackers: _Optional[_Iterable[_Union[TrackerState, _Mapping]]] = ..., headings: _Optional[_Union[HeadingState, _Mapping]] = ..., sections: _Optional[_Union[PositionState, _Mapping]] = ...) -> None: ...

class HeadingState(_message.Message):
    __slots__ = ("number", "turned_rad", "gap_ns", "newest", "jumps", "sum_rad", "sums")
    class Angle(_message.Message):
        __slots__ = ("t_ns", "angle_rad")
        T_NS_FIELD_NUMBER: _ClassVar[int]
        ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
        t_ns: int
        angle_rad: float
        def __init__(self, t_ns: _Optional[int] = ..., angle_rad: _Optional[float] = ...) -> None: ...
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    TURNED_RAD_FIELD_NUMBER: _ClassVar[int]
    GAP_NS_FIELD_NUMBER: _ClassVar[int]
    NEWEST_FIELD_NUMBER: _ClassVar[int]
    JUMPS_FIELD_NUMBER: _ClassVar[int]
    SUM_RAD_FIELD_NUMBER: _ClassVar[int]
    SUMS_FIELD_NUMBER: _ClassVar[int]
    number: int
    turned_rad: float
    gap_ns: int
    newest: AttitudeSample
    jumps: _containers.RepeatedCompositeFieldContainer[HeadingState.Angle]
    sum_rad: float
    sums: _containers.RepeatedCompositeFieldContainer[HeadingState.Angle]
    def __init__(self, number: _Optional[int] = ..., turned_rad: _Optional[float] = ..., gap_ns: _Optional[int] = ..., newest: _Optional[_Union[AttitudeSample, _Mapping]] = ..., jumps: _Optional[_Iterable[_Union[HeadingState.Angle, _Mapping]]] = ..., sum_rad: _Optional[float] = ..., sums: _Optional[_Iterable[_Union[HeadingState.Angle, _Mapping]]] = ...) -> None: ...

class PositionState(_message.Message):
    __slots__ = ("number", "since_ns", "newest", "begun", "sum_m", "sums")
    class Section(_message.Message):
        __slots__ = ("number", "begins_ns", "jump_ns")
        NUMBER_FIELD_NUMBER: _ClassVar[int]
        BEGINS_NS_FIELD_NUMBER: _ClassVar[int]
        JUMP_NS_FIELD_NUMBER: _ClassVar[int]
        number: int
        begins_ns: int
        jump_ns: int
        def __init__(self, number: _Optional[int] = ..., begins_ns: _Optional[int] = ..., jump_ns: _Optional[int] = ...) -> None: ...
    class Sum(_message.Message):
        __slots__ = ("t_ns", "sum_m")
        T_NS_FIELD_NUMBER: _ClassVar[int]
        SUM_M_FIELD_NUMBER: _ClassVar[int]
        t_ns: int
        sum_m: Vector3
        def __init__(self, t_ns: _Optional[int] = ..., sum_m: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    NEWEST_FIELD_NUMBER: _ClassVar[int]
    BEGUN_FIELD_NUMBER: _ClassVar[int]
    SUM_M_FIELD_NUMBER: _ClassVar[int]
    SUMS_FIELD_NUMBER: _ClassVar[int]
    number: int
    since_ns: int
    newest: PoseSample
    begun: _containers.RepeatedCompositeFieldContainer[PositionState.Section]
    sum_m: Vector3
    sums: _containers.RepeatedCompositeFieldContainer[PositionState.Sum]
    def __init__(self, number: _Optional[int] = ..., since_ns: _Optional[int] = ..., newest: _Optional[_Union[PoseSample, _Mapping]] = ..., begun: _Optional[_Iterable[_Union[PositionState.Section, _Mapping]]] = ..., sum_m: _Optional[_Union[Vector3, _Mapping]] = ..., sums: _Optional[_Iterable[_Union[PositionState.Sum, _Mapping]]] = ...) -> None: ...

class TrackerState(_message.Message):
    __slots__ = ("camera", "format", "next_id", "next_object_id", "last_ns", "positioned", "reset_counter", "origin_m", "velocity_x_m_s", "velocity_y_m_s", "slots", "tracks", "cells", "objects", "history", "views", "position_jump_ns", "heading_jump_ns", "lost_from_ns", "lost_to_ns")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    NEXT_ID_FIELD_NUMBER: _ClassVar[int]
    NEXT_OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    LAST_NS_FIELD_NUMBER: _ClassVar[int]
    POSITIONED_FIELD_NUMBER: _ClassVar[int]
    RESET_COUNTER_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_M_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_X_M_S_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_Y_M_S_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    TRACKS_FIELD_NUMBER: _ClassVar[int]
    CELLS_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    HISTORY_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    POSITION_JUMP_NS_FIELD_NUMBER: _ClassVar[int]
    HEADING_JUMP_NS_FIELD_NUMBER: _ClassVar[int]
    LOST_FROM_NS_FIELD_NUMBER: _ClassVar[int]
    LOST_TO_NS_FIELD_NUMBER: _ClassVar[int]
    camera: str
    format: int
    next_id: int
    next_object_id: int
    last_ns: int
    positioned: bool
    reset_counter: int
    origin_m: Vector3
    velocity_x_m_s: float
    velocity_y_m_s: float
    slots: bytes
    tracks: bytes
    cells: bytes
    objects: bytes
    history: bytes
    views: _containers.RepeatedScalarFieldContainer[bytes]
    position_jump_ns: int
    heading_jump_ns: int
    lost_from_ns: _containers.RepeatedScalarFieldContainer[int]
    lost_to_ns: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, camera: _Optional[str] = ..., format: _Optional[int] = ..., next_id: _Optional[int] = ..., next_object_id: _Optional[int] = ..., last_ns: _Optional[int] = ..., positioned: bool = ..., reset_counter: _Optional[int] = ..., origin_m: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_x_m_s: _Optional[float] = ..., velocity_y_m_s: _Optional[float] = ..., slots: _Optional[bytes] = ..., tracks: _Optional[bytes] = ..., cells: _Optional[bytes] = ..., objects: _Optional[bytes] = ..., history: _Optional[bytes] = ..., views: _Optional[_Iterable[bytes]] = ..., position_jump_ns: _Optional[int] = ..., heading_jump_ns: _Optional[int] = ..., lost_from_ns: _Optional[_Iterable[int]] = ..., lost_to_ns: _Optional[_Iterable[int]] = ...) -> None: ...

class RunInfo(_message.Message):
    __slots__ = ("schema_version", "software", "config_json", "packages", "processor", "source", "changed_safety_keys", "changed_expert_keys")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_FIELD_NUMBER: _ClassVar[int]
    CONFIG_JSON_FIELD_NUMBER: _ClassVar[int]
    PACKAGES_FIELD_NUMBER: _ClassVar[int]
    PROCESSOR_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    CHANGED_SAFETY_KEYS_FIELD_NUMBER: _ClassVar[int]
    CHANGED_EXPERT_KEYS_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    software: str
    config_json: str
    packages: _containers.RepeatedScalarFieldContainer[str]
    processor: str
    source: str
    changed_safety_keys: _containers.RepeatedScalarFieldContainer[str]
    changed_expert_keys: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, schema_version: _Optional[int] = ..., software: _Optional[str] = ..., config_json: _Optional[str] = ..., packages: _Optional[_Iterable[str]] = ..., processor: _Optional[str] = ..., source: _Optional[str] = ..., changed_safety_keys: _Optional[_Iterable[str]] = ..., changed_expert_keys: _Optional[_Iterable[str]] = ...) -> None: ...

class MavlinkFrame(_message.Message):
    __slots__ = ("frame",)
    FRAME_FIELD_NUMBER: _ClassVar[int]
    frame: bytes
    def __init__(self, frame: _Optional[bytes] = ...) -> None: ...

class ClockEstimate(_message.Message):
    __slots__ = ("source", "offset_ns", "drift", "at_boot_ns", "bound_ns", "rtt_ns", "exchanges", "restarts")
    class Source(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        SOURCE_NONE: _ClassVar[ClockEstimate.Source]
        SOURCE_ENVELOPE: _ClassVar[ClockEstimate.Source]
        SOURCE_TIMESYNC: _ClassVar[ClockEstimate.Source]
    SOURCE_NONE: ClockEstimate.Source
    SOURCE_ENVELOPE: ClockEstimate.Source
    SOURCE_TIMESYNC: ClockEstimate.Source
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_NS_FIELD_NUMBER: _ClassVar[int]
    DRIFT_FIELD_NUMBER: _ClassVar[int]
    AT_BOOT_NS_FIELD_NUMBER: _ClassVar[int]
    BOUND_NS_FIELD_NUMBER: _ClassVar[int]
    RTT_NS_FIELD_NUMBER: _ClassVar[int]
    EXCHANGES_FIELD_NUMBER: _ClassVar[int]
    RESTARTS_FIELD_NUMBER: _ClassVar[int]
    source: ClockEstimate.Source
    offset_ns: int
    drift: float
    at_boot_ns: int
    bound_ns: int
    rtt_ns: int
    exchanges: int
    restarts: int
    def __init__(self, source: _Optional[_Union[ClockEstimate.Source, str]] = ..., offset_ns: _Optional[int] = ..., drift: _Optional[float] = ..., at_boot_ns: _Optional[int] = ..., bound_ns: _Optional[int] = ..., rtt_ns: _Optional[int] = ..., exchanges: _Optional[int] = ..., restarts: _Optional[int] = ...) -> None: ...

class CameraHealth(_message.Message):
    __slots__ = ("camera", "condition", "cause", "required", "blind", "frames", "dropped", "starts", "last_loss", "age_ns", "hz", "info", "mount", "exposure_offset", "condition_enum", "restart_count", "last_loss_age_ns")
    class Condition(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        CONDITION_UNKNOWN: _ClassVar[CameraHealth.Condition]
        CONDITION_STARTING: _ClassVar[CameraHealth.Condition]
        CONDITION_RUNNING: _ClassVar[CameraHealth.Condition]
        CONDITION_SILENT: _ClassVar[CameraHealth.Condition]
        CONDITION_FROZEN: _ClassVar[CameraHealth.Condition]
        CONDITION_LOST: _ClassVar[CameraHealth.Condition]
        CONDITION_STOPPED: _ClassVar[CameraHealth.Condition]
    CONDITION_UNKNOWN: CameraHealth.Condition
    CONDITION_STARTING: CameraHealth.Condition
    CONDITION_RUNNING: CameraHealth.Condition
    CONDITION_SILENT: CameraHealth.Condition
    CONDITION_FROZEN: CameraHealth.Condition
    CONDITION_LOST: CameraHealth.Condition
    CONDITION_STOPPED: CameraHealth.Condition
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    CONDITION_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    REQUIRED_FIELD_NUMBER: _ClassVar[int]
    BLIND_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    STARTS_FIELD_NUMBER: _ClassVar[int]
    LAST_LOSS_FIELD_NUMBER: _ClassVar[int]
    AGE_NS_FIELD_NUMBER: _ClassVar[int]
    HZ_FIELD_NUMBER: _ClassVar[int]
    INFO_FIELD_NUMBER: _ClassVar[int]
    MOUNT_FIELD_NUMBER: _ClassVar[int]
    EXPOSURE_OFFSET_FIELD_NUMBER: _ClassVar[int]
    CONDITION_ENUM_FIELD_NUMBER: _ClassVar[int]
    RESTART_COUNT_FIELD_NUMBER: _ClassVar[int]
    LAST_LOSS_AGE_NS_FIELD_NUMBER: _ClassVar[int]
    camera: str
    condition: str
    cause: str
    required: bool
    blind: bool
    frames: int
    dropped: int
    starts: int
    last_loss: str
    age_ns: int
    hz: float
    info: CameraInfo
    mount: MountHealth
    exposure_offset: ExposureOffset
    condition_enum: CameraHealth.Condition
    restart_count: int
    last_loss_age_ns: int
    def __init__(self, camera: _Optional[str] = ..., condition: _Optional[str] = ..., cause: _Optional[str] = ..., required: bool = ..., blind: bool = ..., frames: _Optional[int] = ..., dropped: _Optional[int] = ..., starts: _Optional[int] = ..., last_loss: _Optional[str] = ..., age_ns: _Optional[int] = ..., hz: _Optional[float] = ..., info: _Optional[_Union[CameraInfo, _Mapping]] = ..., mount: _Optional[_Union[MountHealth, _Mapping]] = ..., exposure_offset: _Optional[_Union[ExposureOffset, _Mapping]] = ..., condition_enum: _Optional[_Union[CameraHealth.Condition, str]] = ..., restart_count: _Optional[int] = ..., last_loss_age_ns: _Optional[int] = ...) -> None: ...

class ExposureOffset(_message.Message):
    __slots__ = ("state", "text", "offset_ms", "sigma_ms", "pairs", "warns", "state_enum")
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STATE_UNKNOWN: _ClassVar[ExposureOffset.State]
        STATE_NO_ATTITUDE: _ClassVar[ExposureOffset.State]
        STATE_NOT_ENOUGH_MOTION: _ClassVar[ExposureOffset.State]
        STATE_COLLECTING: _ClassVar[ExposureOffset.State]
        STATE_UNCERTAIN: _ClassVar[ExposureOffset.State]
        STATE_MEASURED: _ClassVar[ExposureOffset.State]
    STATE_UNKNOWN: ExposureOffset.State
    STATE_NO_ATTITUDE: ExposureOffset.State
    STATE_NOT_ENOUGH_MOTION: ExposureOffset.State
    STATE_COLLECTING: ExposureOffset.State
    STATE_UNCERTAIN: ExposureOffset.State
    STATE_MEASURED: ExposureOffset.State
    STATE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    OFFSET_MS_FIELD_NUMBER: _ClassVar[int]
    SIGMA_MS_FIELD_NUMBER: _ClassVar[int]
    PAIRS_FIELD_NUMBER: _ClassVar[int]
    WARNS_FIELD_NUMBER: _ClassVar[int]
    STATE_ENUM_FIELD_NUMBER: _ClassVar[int]
    state: str
    text: str
    offset_ms: float
    sigma_ms: float
    pairs: int
    warns: bool
    state_enum: ExposureOffset.State
    def __init__(self, state: _Optional[str] = ..., text: _Optional[str] = ..., offset_ms: _Optional[float] = ..., sigma_ms: _Optional[float] = ..., pairs: _Optional[int] = ..., warns: bool = ..., state_enum: _Optional[_Union[ExposureOffset.State, str]] = ...) -> None: ...

class AutopilotHealth(_message.Message):
    __slots__ = ("address", "line_open", "line_error", "line_warning", "autopilot", "system_id", "armed", "attitude_hz", "position_hz", "clock", "counts", "attitude_age_ns", "flight_mode", "obstacles_sent", "obstacles_echoed", "heartbeat_age_ns")
    class CountsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    ADDRESS_FIELD_NUMBER: _ClassVar[int]
    LINE_OPEN_FIELD_NUMBER: _ClassVar[int]
    LINE_ERROR_FIELD_NUMBER: _ClassVar[int]
    LINE_WARNING_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    SYSTEM_ID_FIELD_NUMBER: _ClassVar[int]
    ARMED_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_HZ_FIELD_NUMBER: _ClassVar[int]
    POSITION_HZ_FIELD_NUMBER: _ClassVar[int]
    CLOCK_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_AGE_NS_FIELD_NUMBER: _ClassVar[int]
    FLIGHT_MODE_FIELD_NUMBER: _ClassVar[int]
    OBSTACLES_SENT_FIELD_NUMBER: _ClassVar[int]
    OBSTACLES_ECHOED_FIELD_NUMBER: _ClassVar[int]
    HEARTBEAT_AGE_NS_FIELD_NUMBER: _ClassVar[int]
    address: str
    line_open: bool
    line_error: str
    line_warning: str
    autopilot: str
    system_id: int
    armed: bool
    attitude_hz: float
    position_hz: float
    clock: ClockEstimate
    counts: _containers.ScalarMap[str, int]
    attitude_age_ns: int
    flight_mode: str
    obstacles_sent: ObstacleSectors
    obstacles_echoed: ObstacleSectors
    heartbeat_age_ns: int
    def __init__(self, address: _Optional[str] = ..., line_open: bool = ..., line_error: _Optional[str] = ..., line_warning: _Optional[str] = ..., autopilot: _Optional[str] = ..., system_id: _Optional[int] = ..., armed: bool = ..., attitude_hz: _Optional[float] = ..., position_hz: _Optional[float] = ..., clock: _Optional[_Union[ClockEstimate, _Mapping]] = ..., counts: _Optional[_Mapping[str, int]] = ..., attitude_age_ns: _Optional[int] = ..., flight_mode: _Optional[str] = ..., obstacles_sent: _Optional[_Union[ObstacleSectors, _Mapping]] = ..., obstacles_echoed: _Optional[_Union[ObstacleSectors, _Mapping]] = ..., heartbeat_age_ns: _Optional[int] = ...) -> None: ...

class ObstacleSectors(_message.Message):
    __slots__ = ("cm", "t_ns", "clear_cm", "first_deg", "step_deg", "body_frame")
    CM_FIELD_NUMBER: _ClassVar[int]
    T_NS_FIELD_NUMBER: _ClassVar[int]
    CLEAR_CM_FIELD_NUMBER: _ClassVar[int]
    FIRST_DEG_FIELD_NUMBER: _ClassVar[int]
    STEP_DEG_FIELD_NUMBER: _ClassVar[int]
    BODY_FRAME_FIELD_NUMBER: _ClassVar[int]
    cm: _containers.RepeatedScalarFieldContainer[int]
    t_ns: int
    clear_cm: int
    first_deg: float
    step_deg: float
    body_frame: bool
    def __init__(self, cm: _Optional[_Iterable[int]] = ..., t_ns: _Optional[int] = ..., clear_cm: _Optional[int] = ..., first_deg: _Optional[float] = ..., step_deg: _Optional[float] = ..., body_frame: bool = ...) -> None: ...

class RecordingHealth(_message.Message):
    __slots__ = ("recording", "file", "bytes", "dropped", "trouble", "repairing")
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    FILE_FIELD_NUMBER: _ClassVar[int]
    BYTES_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    TROUBLE_FIELD_NUMBER: _ClassVar[int]
    REPAIRING_FIELD_NUMBER: _ClassVar[int]
    recording: bool
    file: str
    bytes: int
    dropped: int
    trouble: str
    repairing: str
    def __init__(self, recording: bool = ..., file: _Optional[str] = ..., bytes: _Optional[int] = ..., dropped: _Optional[int] = ..., trouble: _Optional[str] = ..., repairing: _Optional[str] = ...) -> None: ...

class Latency(_message.Message):
    __slots__ = ("stage", "p50_ms", "p95_ms", "p99_ms", "stage_enum", "text")
    class Stage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STAGE_UNKNOWN: _ClassVar[Latency.Stage]
        STAGE_CAMERA: _ClassVar[Latency.Stage]
        STAGE_WAIT: _ClassVar[Latency.Stage]
        STAGE_EXTRACT: _ClassVar[Latency.Stage]
        STAGE_EXTRACT_CPU: _ClassVar[Latency.Stage]
        STAGE_PUBLISH: _ClassVar[Latency.Stage]
        STAGE_EXPOSURE_TO_PUBLISH: _ClassVar[Latency.Stage]
        STAGE_EXPOSURE_TO_AUTOPILOT: _ClassVar[Latency.Stage]
    STAGE_UNKNOWN: Latency.Stage
    STAGE_CAMERA: Latency.Stage
    STAGE_WAIT: Latency.Stage
    STAGE_EXTRACT: Latency.Stage
    STAGE_EXTRACT_CPU: Latency.Stage
    STAGE_PUBLISH: Latency.Stage
    STAGE_EXPOSURE_TO_PUBLISH: Latency.Stage
    STAGE_EXPOSURE_TO_AUTOPILOT: Latency.Stage
    STAGE_FIELD_NUMBER: _ClassVar[int]
    P50_MS_FIELD_NUMBER: _ClassVar[int]
    P95_MS_FIELD_NUMBER: _ClassVar[int]
    P99_MS_FIELD_NUMBER: _ClassVar[int]
    STAGE_ENUM_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    stage: str
    p50_ms: float
    p95_ms: float
    p99_ms: float
    stage_enum: Latency.Stage
    text: str
    def __init__(self, stage: _Optional[str] = ..., p50_ms: _Optional[float] = ..., p95_ms: _Optional[float] = ..., p99_ms: _Optional[float] = ..., stage_enum: _Optional[_Union[Latency.Stage, str]] = ..., text: _Optional[str] = ...) -> None: ...

class Temperature(_message.Message):
    __slots__ = ("sensor", "celsius")
    SENSOR_FIELD_NUMBER: _ClassVar[int]
    CELSIUS_FIELD_NUMBER: _ClassVar[int]
    sensor: str
    celsius: float
    def __init__(self, sensor: _Optional[str] = ..., celsius: _Optional[float] = ...) -> None: ...

class Health(_message.Message):
    __slots__ = ("schema_version", "boot_id", "number", "t_ns", "state", "troubles", "cameras", "autopilot", "recording", "latencies", "temperatures", "frames_used", "frames_dropped", "cpu_share", "memory_bytes", "uptime_ns", "samples_lost", "notes", "changed_safety_keys", "diagnostics", "team")
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STATE_UNKNOWN: _ClassVar[Health.State]
        STATE_STARTING: _ClassVar[Health.State]
        STATE_ACTIVE: _ClassVar[Health.State]
        STATE_DEGRADED: _ClassVar[Health.State]
        STATE_BLIND: _ClassVar[Health.State]
    STATE_UNKNOWN: Health.State
    STATE_STARTING: Health.State
    STATE_ACTIVE: Health.State
    STATE_DEGRADED: Health.State
    STATE_BLIND: Health.State
    class FramesDroppedEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    BOOT_ID_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    T_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    TROUBLES_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    RECORDING_FIELD_NUMBER: _ClassVar[int]
    LATENCIES_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURES_FIELD_NUMBER: _ClassVar[int]
    FRAMES_USED_FIELD_NUMBER: _ClassVar[int]
    FRAMES_DROPPED_FIELD_NUMBER: _ClassVar[int]
    CPU_SHARE_FIELD_NUMBER: _ClassVar[int]
    MEMORY_BYTES_FIELD_NUMBER: _ClassVar[int]
    UPTIME_NS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_LOST_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    CHANGED_SAFETY_KEYS_FIELD_NUMBER: _ClassVar[int]
    DIAGNOSTICS_FIELD_NUMBER: _ClassVar[int]
    TEAM_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    boot_id: str
    number: int
    t_ns: int
    state: Health.State
    troubles: _containers.RepeatedScalarFieldContainer[str]
    cameras: _containers.RepeatedCompositeFieldContainer[CameraHealth]
    autopilot: AutopilotHealth
    recording: RecordingHealth
    latencies: _containers.RepeatedCompositeFieldContainer[Latency]
    temperatures: _containers.RepeatedCompositeFieldContainer[Temperature]
    frames_used: int
    frames_dropped: _containers.ScalarMap[str, int]
    cpu_share: float
    memory_bytes: int
    uptime_ns: int
    samples_lost: int
    notes: _containers.RepeatedScalarFieldContainer[str]
    changed_safety_keys: _containers.RepeatedScalarFieldContainer[str]
    diagnostics: _containers.RepeatedCompositeFieldContainer[Diagnostic]
    team: TeamHealth
    def __init__(self, schema_version: _Optional[int] = ..., boot_id: _Optional[str] = ..., number: _Optional[int] = ..., t_ns: _Optional[int] = ..., state: _Optional[_Union[Health.State, str]] = ..., troubles: _Optional[_Iterable[str]] = ..., cameras: _Optional[_Iterable[_Union[CameraHealth, _Mapping]]] = ..., autopilot: _Optional[_Union[AutopilotHealth, _Mapping]] = ..., recording: _Optional[_Union[RecordingHealth, _Mapping]] = ..., latencies: _Optional[_Iterable[_Union[Latency, _Mapping]]] = ..., temperatures: _Optional[_Iterable[_Union[Temperature, _Mapping]]] = ..., frames_used: _Optional[int] = ..., frames_dropped: _Optional[_Mapping[str, int]] = ..., cpu_share: _Optional[float] = ..., memory_bytes: _Optional[int] = ..., uptime_ns: _Optional[int] = ..., samples_lost: _Optional[int] = ..., notes: _Optional[_Iterable[str]] = ..., changed_safety_keys: _Optional[_Iterable[str]] = ..., diagnostics: _Optional[_Iterable[_Union[Diagnostic, _Mapping]]] = ..., team: _Optional[_Union[TeamHealth, _Mapping]] = ...) -> None: ...

class TeamHealth(_message.Message):
    __slots__ = ("vehicle", "neighbours", "received", "links", "frame_known")
    class ReceivedEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    NEIGHBOURS_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_FIELD_NUMBER: _ClassVar[int]
    LINKS_FIELD_NUMBER: _ClassVar[int]
    FRAME_KNOWN_FIELD_NUMBER: _ClassVar[int]
    vehicle: int
    neighbours: _containers.RepeatedCompositeFieldContainer[NeighbourHealth]
    received: _containers.ScalarMap[str, int]
    links: _containers.RepeatedCompositeFieldContainer[TeamLinkHealth]
    frame_known: bool
    def __init__(self, vehicle: _Optional[int] = ..., neighbours: _Optional[_Iterable[_Union[NeighbourHealth, _Mapping]]] = ..., received: _Optional[_Mapping[str, int]] = ..., links: _Optional[_Iterable[_Union[TeamLinkHealth, _Mapping]]] = ..., frame_known: bool = ...) -> None: ...

class TeamLinkHealth(_message.Message):
    __slots__ = ("name", "fault", "sent_bytes", "sent_packets", "sent_bytes_per_s", "unencodable")
    NAME_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    SENT_BYTES_FIELD_NUMBER: _ClassVar[int]
    SENT_PACKETS_FIELD_NUMBER: _ClassVar[int]
    SENT_BYTES_PER_S_FIELD_NUMBER: _ClassVar[int]
    UNENCODABLE_FIELD_NUMBER: _ClassVar[int]
    name: str
    fault: str
    sent_bytes: int
    sent_packets: int
    sent_bytes_per_s: float
    unencodable: int
    def __init__(self, name: _Optional[str] = ..., fault: _Optional[str] = ..., sent_bytes: _Optional[int] = ..., sent_packets: _Optional[int] = ..., sent_bytes_per_s: _Optional[float] = ..., unencodable: _Optional[int] = ...) -> None: ...

class NeighbourHealth(_message.Message):
    __slots__ = ("vehicle", "silent_s", "placement", "fit", "sigma_m", "planes", "movers", "withheld", "packets", "refused", "position_m")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    SILENT_S_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    FIT_FIELD_NUMBER: _ClassVar[int]
    SIGMA_M_FIELD_NUMBER: _ClassVar[int]
    PLANES_FIELD_NUMBER: _ClassVar[int]
    MOVERS_FIELD_NUMBER: _ClassVar[int]
    WITHHELD_FIELD_NUMBER: _ClassVar[int]
    PACKETS_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_NUMBER: _ClassVar[int]
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    vehicle: int
    silent_s: float
    placement: str
    fit: str
    sigma_m: float
    planes: int
    movers: int
    withheld: int
    packets: int
    refused: int
    position_m: Vector3
    def __init__(self, vehicle: _Optional[int] = ..., silent_s: _Optional[float] = ..., placement: _Optional[str] = ..., fit: _Optional[str] = ..., sigma_m: _Optional[float] = ..., planes: _Optional[int] = ..., movers: _Optional[int] = ..., withheld: _Optional[int] = ..., packets: _Optional[int] = ..., refused: _Optional[int] = ..., position_m: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Diagnostic(_message.Message):
    __slots__ = ("code", "camera", "text", "code_enum")
    class Code(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        CODE_UNKNOWN: _ClassVar[Diagnostic.Code]
        CODE_STARTING: _ClassVar[Diagnostic.Code]
        CODE_THREAD_STALLED: _ClassVar[Diagnostic.Code]
        CODE_SERVICE_UNREACHABLE: _ClassVar[Diagnostic.Code]
        CODE_RESEARCH_MODE: _ClassVar[Diagnostic.Code]
        CODE_NO_CAMERA_CONFIGURED: _ClassVar[Diagnostic.Code]
        CODE_NOT_A_LIVE_CAMERA: _ClassVar[Diagnostic.Code]
        CODE_CAMERA_UNAVAILABLE: _ClassVar[Diagnostic.Code]
        CODE_OPTIONAL_CAMERA_UNAVAILABLE: _ClassVar[Diagnostic.Code]
        CODE_CAMERA_FEW_MEASURED: _ClassVar[Diagnostic.Code]
        CODE_CAMERA_RATE_LOW: _ClassVar[Diagnostic.Code]
        CODE_TEMPLATE_INTRINSICS: _ClassVar[Diagnostic.Code]
        CODE_INTRINSICS_DIFFER: _ClassVar[Diagnostic.Code]
        CODE_SEVERAL_VEHICLES: _ClassVar[Diagnostic.Code]
        CODE_EXPOSURE_TIME_OFFSET: _ClassVar[Diagnostic.Code]
        CODE_MOUNT_ERROR: _ClassVar[Diagnostic.Code]
        CODE_MOUNT_DEGRADED: _ClassVar[Diagnostic.Code]
        CODE_MOUNT_UNVERIFIED: _ClassVar[Diagnostic.Code]
        CODE_GROUND_SLOPE_LIMIT: _ClassVar[Diagnostic.Code]
        CODE_GROUND_LOST: _ClassVar[Diagnostic.Code]
        CODE_GROUND_NEVER_SEEN: _ClassVar[Diagnostic.Code]
        CODE_NO_AUTOPILOT_CONFIGURED: _ClassVar[Diagnostic.Code]
        CODE_LINK_CLOSED: _ClassVar[Diagnostic.Code]
        CODE_LINK_SLOW: _ClassVar[Diagnostic.Code]
        CODE_UDP_FLOOD: _ClassVar[Diagnostic.Code]
        CODE_SIGNING_FAULT: _ClassVar[Diagnostic.Code]
        CODE_DUPLICATE_AUTOPILOT: _ClassVar[Diagnostic.Code]
        CODE_DUPLICATE_OBSTACLE_SOURCE: _ClassVar[Diagnostic.Code]
        CODE_DUPLICATE_COMPONENT: _ClassVar[Diagnostic.Code]
        CODE_SYSTEM_ID_MISMATCH: _ClassVar[Diagnostic.Code]
        CODE_NO_HEARTBEAT: _ClassVar[Diagnostic.Code]
        CODE_ATTITUDE_STALE: _ClassVar[Diagnostic.Code]
        CODE_ATTITUDE_RATE_LOW: _ClassVar[Diagnostic.Code]
        CODE_NO_TIMESYNC: _ClassVar[Diagnostic.Code]
        CODE_AUTOPILOT_SAMPLES_LOST: _ClassVar[Diagnostic.Code]
        CODE_AVOIDANCE_FAULT: _ClassVar[Diagnostic.Code]
        CODE_OBSTACLES_NOT_ACCEPTED: _ClassVar[Diagnostic.Code]
        CODE_FLIGHT_MODE_UNPROTECTED: _ClassVar[Diagnostic.Code]
        CODE_PARAMETERS_UNKNOWN: _ClassVar[Diagnostic.Code]
        CODE_PARAMETER_ADVICE: _ClassVar[Diagnostic.Code]
        CODE_PARAMETER_CONTRADICTION: _ClassVar[Diagnostic.Code]
        CODE_PARAMETERS_NOT_WRITTEN: _ClassVar[Diagnostic.Code]
        CODE_AVOID_MARGIN_UNKNOWN: _ClassVar[Diagnostic.Code]
        CODE_RECORDING_FAULT: _ClassVar[Diagnostic.Code]
        CODE_LOG_NOT_WRITABLE: _ClassVar[Diagnostic.Code]
        CODE_DISK_LOW: _ClassVar[Diagnostic.Code]
        CODE_METRICS_FAULT: _ClassVar[Diagnostic.Code]
        CODE_DEPTH_PREVIEW_FAULT: _ClassVar[Diagnostic.Code]
        CODE_SIGNATURE_CLOCK_FAULT: _ClassVar[Diagnostic.Code]
        CODE_KEY_CHECK_FAULT: _ClassVar[Diagnostic.Code]
        CODE_WORLD_FAULT: _ClassVar[Diagnostic.Code]
        CODE_WORLD_STALLED: _ClassVar[Diagnostic.Code]
        CODE_KERNEL_CACHE_DAMAGED: _ClassVar[Diagnostic.Code]
        CODE_KERNELS_NOT_COMPILED: _ClassVar[Diagnostic.Code]
        CODE_MOUNT_YAW_ERROR: _ClassVar[Diagnostic.Code]
        CODE_GUARD_UNAVAILABLE: _ClassVar[Diagnostic.Code]
        CODE_GUARD_INTERVENES: _ClassVar[Diagnostic.Code]
        CODE_GUARD_FAULT: _ClassVar[Diagnostic.Code]
        CODE_SHARE_FAULT: _ClassVar[Diagnostic.Code]
        CODE_SHARE_LINK_CLOSED: _ClassVar[Diagnostic.Code]
        CODE_SHARE_NO_FRAME: _ClassVar[Diagnostic.Code]
        CODE_SHARE_NOT_AUTHENTICATED: _ClassVar[Diagnostic.Code]
        CODE_CLOCK_UNCERTAIN: _ClassVar[Diagnostic.Code]
        CODE_NEVER_CLEAR: _ClassVar[Diagnostic.Code]
        CODE_CAMERA_MISALIGNED: _ClassVar[Diagnostic.Code]
        CODE_ATTITUDE_REPEATED: _ClassVar[Diagnostic.Code]
    CODE_UNKNOWN: Diagnostic.Code
    CODE_STARTING: Diagnostic.Code
    CODE_THREAD_STALLED: Diagnostic.Code
    CODE_SERVICE_UNREACHABLE: Diagnostic.Code
    CODE_RESEARCH_MODE: Diagnostic.Code
    CODE_NO_CAMERA_CONFIGURED: Diagnostic.Code
    CODE_NOT_A_LIVE_CAMERA: Diagnostic.Code
    CODE_CAMERA_UNAVAILABLE: Diagnostic.Code
    CODE_OPTIONAL_CAMERA_UNAVAILABLE: Diagnostic.Code
    CODE_CAMERA_FEW_MEASURED: Diagnostic.Code
    CODE_CAMERA_RATE_LOW: Diagnostic.Code
    CODE_TEMPLATE_INTRINSICS: Diagnostic.Code
    CODE_INTRINSICS_DIFFER: Diagnostic.Code
    CODE_SEVERAL_VEHICLES: Diagnostic.Code
    CODE_EXPOSURE_TIME_OFFSET: Diagnostic.Code
    CODE_MOUNT_ERROR: Diagnostic.Code
    CODE_MOUNT_DEGRADED: Diagnostic.Code
    CODE_MOUNT_UNVERIFIED: Diagnostic.Code
    CODE_GROUND_SLOPE_LIMIT: Diagnostic.Code
    CODE_GROUND_LOST: Diagnostic.Code
    CODE_GROUND_NEVER_SEEN: Diagnostic.Code
    CODE_NO_AUTOPILOT_CONFIGURED: Diagnostic.Code
    CODE_LINK_CLOSED: Diagnostic.Code
    CODE_LINK_SLOW: Diagnostic.Code
    CODE_UDP_FLOOD: Diagnostic.Code
    CODE_SIGNING_FAULT: Diagnostic.Code
    CODE_DUPLICATE_AUTOPILOT: Diagnostic.Code
    CODE_DUPLICATE_OBSTACLE_SOURCE: Diagnostic.Code
    CODE_DUPLICATE_COMPONENT: Diagnostic.Code
    CODE_SYSTEM_ID_MISMATCH: Diagnostic.Code
    CODE_NO_HEARTBEAT: Diagnostic.Code
    CODE_ATTITUDE_STALE: Diagnostic.Code
    CODE_ATTITUDE_RATE_LOW: Diagnostic.Code
    CODE_NO_TIMESYNC: Diagnostic.Code
    CODE_AUTOPILOT_SAMPLES_LOST: Diagnostic.Code
    CODE_AVOIDANCE_FAULT: Diagnostic.Code
    CODE_OBSTACLES_NOT_ACCEPTED: Diagnostic.Code
    CODE_FLIGHT_MODE_UNPROTECTED: Diagnostic.Code
    CODE_PARAMETERS_UNKNOWN: Diagnostic.Code
    CODE_PARAMETER_ADVICE: Diagnostic.Code
    CODE_PARAMETER_CONTRADICTION: Diagnostic.Code
    CODE_PARAMETERS_NOT_WRITTEN: Diagnostic.Code
    CODE_AVOID_MARGIN_UNKNOWN: Diagnostic.Code
    CODE_RECORDING_FAULT: Diagnostic.Code
    CODE_LOG_NOT_WRITABLE: Diagnostic.Code
    CODE_DISK_LOW: Diagnostic.Code
    CODE_METRICS_FAULT: Diagnostic.Code
    CODE_DEPTH_PREVIEW_FAULT: Diagnostic.Code
    CODE_SIGNATURE_CLOCK_FAULT: Diagnostic.Code
    CODE_KEY_CHECK_FAULT: Diagnostic.Code
    CODE_WORLD_FAULT: Diagnostic.Code
    CODE_WORLD_STALLED: Diagnostic.Code
    CODE_KERNEL_CACHE_DAMAGED: Diagnostic.Code
    CODE_KERNELS_NOT_COMPILED: Diagnostic.Code
    CODE_MOUNT_YAW_ERROR: Diagnostic.Code
    CODE_GUARD_UNAVAILABLE: Diagnostic.Code
    CODE_GUARD_INTERVENES: Diagnostic.Code
    CODE_GUARD_FAULT: Diagnostic.Code
    CODE_SHARE_FAULT: Diagnostic.Code
    CODE_SHARE_LINK_CLOSED: Diagnostic.Code
    CODE_SHARE_NO_FRAME: Diagnostic.Code
    CODE_SHARE_NOT_AUTHENTICATED: Diagnostic.Code
    CODE_CLOCK_UNCERTAIN: Diagnostic.Code
    CODE_NEVER_CLEAR: Diagnostic.Code
    CODE_CAMERA_MISALIGNED: Diagnostic.Code
    CODE_ATTITUDE_REPEATED: Diagnostic.Code
    CODE_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    CODE_ENUM_FIELD_NUMBER: _ClassVar[int]
    code: str
    camera: str
    text: str
    code_enum: Diagnostic.Code
    def __init__(self, code: _Optional[str] = ..., camera: _Optional[str] = ..., text: _Optional[str] = ..., code_enum: _Optional[_Union[Diagnostic.Code, str]] = ...) -> None: ...

class WorldUpdate(_message.Message):
    __slots__ = ("schema_version", "snapshot", "sequence", "section", "valid", "cause_text", "t_ns", "planes", "removed", "blocks", "masks", "ground", "counts", "publication", "cause")
    class Cause(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        CAUSE_NONE: _ClassVar[WorldUpdate.Cause]
        CAUSE_NO_POSITION: _ClassVar[WorldUpdate.Cause]
        CAUSE_POSITION_STALE: _ClassVar[WorldUpdate.Cause]
    CAUSE_NONE: WorldUpdate.Cause
    CAUSE_NO_POSITION: WorldUpdate.Cause
    CAUSE_POSITION_STALE: WorldUpdate.Cause
    class CountsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    SECTION_FIELD_NUMBER: _ClassVar[int]
    VALID_FIELD_NUMBER: _ClassVar[int]
    CAUSE_TEXT_FIELD_NUMBER: _ClassVar[int]
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PLANES_FIELD_NUMBER: _ClassVar[int]
    REMOVED_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    MASKS_FIELD_NUMBER: _ClassVar[int]
    GROUND_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    snapshot: bool
    sequence: int
    section: int
    valid: bool
    cause_text: str
    t_ns: int
    planes: bytes
    removed: _containers.RepeatedScalarFieldContainer[int]
    blocks: _containers.RepeatedScalarFieldContainer[int]
    masks: bytes
    ground: bytes
    counts: _containers.ScalarMap[str, int]
    publication: Publication
    cause: WorldUpdate.Cause
    def __init__(self, schema_version: _Optional[int] = ..., snapshot: bool = ..., sequence: _Optional[int] = ..., section: _Optional[int] = ..., valid: bool = ..., cause_text: _Optional[str] = ..., t_ns: _Optional[int] = ..., planes: _Optional[bytes] = ..., removed: _Optional[_Iterable[int]] = ..., blocks: _Optional[_Iterable[int]] = ..., masks: _Optional[bytes] = ..., ground: _Optional[bytes] = ..., counts: _Optional[_Mapping[str, int]] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ..., cause: _Optional[_Union[WorldUpdate.Cause, str]] = ...) -> None: ...

class DepthPreview(_message.Message):
    __slots__ = ("schema_version", "camera", "sequence", "t_exposure_ns", "width_px", "height_px", "depth_mm", "publication")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    T_EXPOSURE_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MM_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    camera: str
    sequence: int
    t_exposure_ns: int
    width_px: int
    height_px: int
    depth_mm: bytes
    publication: Publication
    def __init__(self, schema_version: _Optional[int] = ..., camera: _Optional[str] = ..., sequence: _Optional[int] = ..., t_exposure_ns: _Optional[int] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., depth_mm: _Optional[bytes] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ...) -> None: ...

class TeamPacket(_message.Message):
    __slots__ = ("transport", "data", "sent", "sender", "refused")
    TRANSPORT_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    SENT_FIELD_NUMBER: _ClassVar[int]
    SENDER_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_NUMBER: _ClassVar[int]
    transport: str
    data: bytes
    sent: bool
    sender: int
    refused: str
    def __init__(self, transport: _Optional[str] = ..., data: _Optional[bytes] = ..., sent: bool = ..., sender: _Optional[int] = ..., refused: _Optional[str] = ...) -> None: ...

class NeighbourObstacles(_message.Message):
    __slots__ = ("schema_version", "t_ns", "section", "sender", "id", "corners_m", "margin_m", "age_s", "flags", "aligned", "movers", "neighbours", "publication")
    SCHEMA_VERSION_FIELD_NUMBER: _ClassVar[int]
    T_NS_FIELD_NUMBER: _ClassVar[int]
    SECTION_FIELD_NUMBER: _ClassVar[int]
    SENDER_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    CORNERS_M_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    AGE_S_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    ALIGNED_FIELD_NUMBER: _ClassVar[int]
    MOVERS_FIELD_NUMBER: _ClassVar[int]
    NEIGHBOURS_FIELD_NUMBER: _ClassVar[int]
    PUBLICATION_FIELD_NUMBER: _ClassVar[int]
    schema_version: int
    t_ns: int
    section: int
    sender: bytes
    id: _containers.RepeatedScalarFieldContainer[int]
    corners_m: _containers.RepeatedScalarFieldContainer[float]
    margin_m: _containers.RepeatedScalarFieldContainer[float]
    age_s: _containers.RepeatedScalarFieldContainer[float]
    flags: _containers.RepeatedScalarFieldContainer[int]
    aligned: bytes
    movers: _containers.RepeatedCompositeFieldContainer[NeighbourMover]
    neighbours: _containers.RepeatedCompositeFieldContainer[NeighbourHealth]
    publication: Publication
    def __init__(self, schema_version: _Optional[int] = ..., t_ns: _Optional[int] = ..., section: _Optional[int] = ..., sender: _Optional[bytes] = ..., id: _Optional[_Iterable[int]] = ..., corners_m: _Optional[_Iterable[float]] = ..., margin_m: _Optional[_Iterable[float]] = ..., age_s: _Optional[_Iterable[float]] = ..., flags: _Optional[_Iterable[int]] = ..., aligned: _Optional[bytes] = ..., movers: _Optional[_Iterable[_Union[NeighbourMover, _Mapping]]] = ..., neighbours: _Optional[_Iterable[_Union[NeighbourHealth, _Mapping]]] = ..., publication: _Optional[_Union[Publication, _Mapping]] = ...) -> None: ...

class NeighbourMover(_message.Message):
    __slots__ = ("sender", "id", "kind", "centre_m", "half_size_m", "velocity_x_m_s", "velocity_y_m_s", "margin_m", "age_s")
    class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        KIND_UNKNOWN: _ClassVar[NeighbourMover.Kind]
        KIND_OBSTACLE: _ClassVar[NeighbourMover.Kind]
        KIND_VEHICLE: _ClassVar[NeighbourMover.Kind]
    KIND_UNKNOWN: NeighbourMover.Kind
    KIND_OBSTACLE: NeighbourMover.Kind
    KIND_VEHICLE: NeighbourMover.Kind
    SENDER_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    CENTRE_M_FIELD_NUMBER: _ClassVar[int]
    HALF_SIZE_M_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_X_M_S_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_Y_M_S_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    AGE_S_FIELD_NUMBER: _ClassVar[int]
    sender: int
    id: int
    kind: NeighbourMover.Kind
    centre_m: Vector3
    half_size_m: Vector3
    velocity_x_m_s: float
    velocity_y_m_s: float
    margin_m: float
    age_s: float
    def __init__(self, sender: _Optional[int] = ..., id: _Optional[int] = ..., kind: _Optional[_Union[NeighbourMover.Kind, str]] = ..., centre_m: _Optional[_Union[Vector3, _Mapping]] = ..., half_size_m: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_x_m_s: _Optional[float] = ..., velocity_y_m_s: _Optional[float] = ..., margin_m: _Optional[float] = ..., age_s: _Optional[float] = ...) -> None: ...
