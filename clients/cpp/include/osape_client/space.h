// Query of one frame: is a ball, or the way of a ball, free, occupied or unknown? For a ball the answers are those of
// osape_client.Space in Python. A way is covered by other balls than those of Space.segments: at borders the answers differ.
//
// Occupied: it touches a plane or its margin, or touches or lies below the ground where the camera measured the ground.
// Free: all of it lies in space that the camera observed to be free, above the camera's ground. Else it is unknown.
// Open is a fourth answer, for callers that ask for it: all of it lies in space that was observed free or is presumed free without
// a measurement. Without allow_open that is unknown.
// A frame has no age: query a received one through its Message (subscriber.h).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "osape_v1.pb.h"

namespace osape_client {

enum class Occupancy { kUnknown = 0, kFree = 1, kOccupied = 2, kOpen = 3 };

struct Point {
  double x, y, z;
};

constexpr double kTurn = 6.283185307179586;
constexpr double kMostTurn = kTurn + 1e-5;  // of the directions of a profile, whose edges are rounded to float
constexpr double kDefaultGroundToleranceM = 0.6;  // for messages of versions without a tolerance

// Distance of the balls that cover a way; greatest number of distances, beyond which they are larger.
constexpr double kWayStepM = 0.1;
constexpr double kMostWaySteps = 10000.0;

// No position is farther from the origin along any axis, as in Python: such a number is handled like one that is not finite.
constexpr double kMostM = 1e9;

inline bool is_position(const Point& p) {
  return std::abs(p.x) <= kMostM && std::abs(p.y) <= kMostM && std::abs(p.z) <= kMostM;
}

inline bool are_positions(const google::protobuf::RepeatedField<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::abs(static_cast<double>(value)) <= kMostM; });
}

inline bool finite(const google::protobuf::RepeatedField<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

inline bool are_increasing(const google::protobuf::RepeatedField<float>& edges) {
  return are_positions(edges) && std::is_sorted(edges.begin(), edges.end());
}

// Whether a number can be a margin.
inline bool is_margin(double value) { return value >= 0.0 && value <= kMostM; }

constexpr std::uint32_t kMostSupportPx = 0x7fffffff;

// Whether planes are rectangles with margins: one that is not of positions would touch nothing.
inline bool planes_fit(const osape::v1::Planes& planes) {
  const int count = planes.margin_m_size();
  if (planes.corners_m_size() != 6 * count || !are_positions(planes.corners_m())) return false;
  if (planes.support_px_size() != count || planes.flags_size() != count || planes.cluster_size() != count) return false;
  for (int i = 0; i < count; ++i) {
    if (!is_margin(planes.margin_m(i))) return false;
    if (planes.support_px(i) > kMostSupportPx) return false;
    if (!(planes.corners_m(6 * i + 4) < planes.corners_m(6 * i + 5))) return false;  // z points down
  }
  return true;
}

// Whether the prisms are profiles with an edge for each plane, between two heights. They are not queried, but a message with a
// damaged one is damaged.
inline bool prism_fits(const osape::v1::Prism& prism) {
  const int vertices = prism.vertices_m_size() / 2, edges = vertices - (prism.closed() ? 0 : 1);
  if (prism.vertices_m_size() != 2 * vertices || prism.plane_size() != edges || !finite(prism.vertices_m())) return false;
  const bool layer = std::isfinite(prism.top_m()) && std::isfinite(prism.bottom_m()) && prism.top_m() < prism.bottom_m();
  return layer && std::isfinite(prism.margin_m()) && prism.margin_m() >= 0.0f;
}

// Whether the tables of a profile have an entry per direction and layer, no number is beyond kMostM, and its edges increase and are
// at most one turn.
inline bool profile_fits(const osape::v1::FreeProfile& free) {
  if (free.azimuth_edges_rad().empty() || free.layer_edges_m().empty()) return false;  // each message has some
  const auto directions = static_cast<std::size_t>(free.azimuth_edges_rad_size() - 1);
  const auto size = directions * static_cast<std::size_t>(free.layer_edges_m_size() - 1);
  const auto from = static_cast<std::size_t>(free.free_from_m_size()), to = static_cast<std::size_t>(free.free_to_m_size());
  if (from != size || to != size || free.end().size() != size) return false;
  const bool presumes = !free.open_from_dm().empty() || !free.open_to_dm().empty();
  if (presumes && (free.open_from_dm().size() != size || free.open_to_dm().size() != size)) return false;
  if (!are_positions(free.free_from_m()) || !are_positions(free.free_to_m())) return false;
  const auto& azimuths = free.azimuth_edges_rad();
  if (!are_increasing(azimuths) || !are_increasing(free.layer_edges_m())) return false;
  return static_cast<double>(*azimuths.rbegin()) - *azimuths.begin() <= kMostTurn;
}

// Whether a frame was processed and its message is whole: of a message cut short the position of the camera may be missing. A cause
// of a valid frame is of a newer version or of a damaged message, as is an unknown frame of the coordinates.
inline bool usable(const osape::v1::PrismsFrame& frame) {
  if (frame.frame() != "level" && frame.frame() != "ned") return false;
  return frame.valid() && frame.cause() == osape::v1::CAUSE_NONE && frame.has_stats() && frame.has_transform();
}

// Whether the numbers of a frame fit together; of a damaged message everything is unknown.
inline bool numbers_fit(const osape::v1::PrismsFrame& frame) {
  const auto& g = frame.ground();
  if (!planes_fit(frame.planes()) || !profile_fits(frame.free())) return false;
  if (!std::all_of(frame.prisms().begin(), frame.prisms().end(), prism_fits)) return false;
  const auto& camera = frame.transform().translation_m();
  if (!is_position({camera.x(), camera.y(), camera.z()})) return false;
  if (!g.seen()) return true;
  const bool margins = is_margin(g.noise_per_m()) && is_margin(g.tolerance_m());
  const bool plane = is_position({g.slope_x(), g.slope_y(), g.height_m()});
  return margins && plane && are_positions(g.seen_from_m()) && are_positions(g.seen_to_m());
}

// Horizontal range from the camera.
inline double range_m(const osape::v1::PrismsFrame& frame, const Point& p) {
  const auto& camera = frame.transform().translation_m();
  return std::hypot(p.x - camera.x(), p.y - camera.y());
}

// Metres straight up from the ground's plane to a point.
inline double above_ground_m(const osape::v1::PrismsFrame& frame, const Point& p) {
  const auto& camera = frame.transform().translation_m();
  const auto& g = frame.ground();
  return camera.z() + g.height_m() + g.slope_x() * (p.x - camera.x()) + g.slope_y() * (p.y - camera.y()) - p.z;
}

// Metres straight down to the ground's plane for a metre square to it.
inline double steepness(const osape::v1::Ground& g) {
  return std::hypot(1.0, g.slope_x(), g.slope_y());
}

// The azimuths low..high that a ball reaches into, low within one turn of the profile's first edge (edges are not wrapped).
inline void azimuths(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m, double* low, double* high) {
  const auto& camera = frame.transform().translation_m();
  const double range = range_m(frame, p), begin = frame.free().azimuth_edges_rad(0);
  const double half = range > radius_m ? std::asin(std::clamp(radius_m / range, 0.0, 1.0)) : 0.5 * kTurn;
  const double from_begin = std::fmod(std::atan2(p.y - camera.y(), p.x - camera.x()) - half - begin, kTurn);
  *low = (from_begin < 0.0 ? from_begin + kTurn : from_begin) + begin;
  *high = *low + 2.0 * half;
}

// First and last interval of increasing edges that low..high reaches into; they may lie outside of 0..edges - 2.
inline void intervals(const google::protobuf::RepeatedField<float>& edges, double low, double high, int* first, int* last) {
  *first = static_cast<int>(std::upper_bound(edges.begin(), edges.end(), low) - edges.begin()) - 1;
  *last = static_cast<int>(std::lower_bound(edges.begin(), edges.end(), high) - edges.begin()) - 1;
  *last = std::max(*first, *last);
}

// Whether a ball touches the ground, its noise included, or lies below it, where the camera measured it.
inline bool touches_ground(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m) {
  const auto& g = frame.ground();
  const int count = frame.free().azimuth_edges_rad_size() - 1;
  if (!g.seen() || count < 1 || g.seen_from_m_size() != count || g.seen_to_m_size() != count) return false;
  const double range = range_m(frame, p);
  if (!(above_ground_m(frame, p) < steepness(g) * radius_m + g.noise_per_m() * (range + radius_m))) return false;
  const auto& edges = frame.free().azimuth_edges_rad();
  double low, high;
  azimuths(frame, p, radius_m, &low, &high);
  for (const double turn : {0.0, -kTurn}) {  // a ball that begins left of the first edge may reach into the view
    const double begin = std::max<double>(low + turn, edges.Get(0)), end = std::min<double>(high + turn, edges.Get(count));
    if (end < begin) continue;
    int first, last;
    intervals(edges, begin, end, &first, &last);
    for (int d = std::max(0, first); d <= std::min(last, count - 1); ++d) {
      const double from = g.seen_from_m(d), to = g.seen_to_m(d);
      if (to > from && range + radius_m >= from && range - radius_m <= to) return true;
    }
  }
  return false;
}

// Whether a ball is above the ground by its tolerance and noise; nothing lower is free anywhere.
inline bool clear_of_ground(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m) {
  const auto& g = frame.ground();
  if (!g.seen()) return true;
  const double tolerance = g.has_tolerance_m() ? g.tolerance_m() : kDefaultGroundToleranceM;
  const double margin = std::max(tolerance, g.noise_per_m() * (range_m(frame, p) + radius_m));
  return above_ground_m(frame, p) >= steepness(g) * radius_m + margin;
}

// Whether a ball comes as near to a plane as its margin.
inline bool touches_plane(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m) {
  const auto& planes = frame.planes();
  for (int i = 0; i < planes.margin_m_size() && 6 * i + 5 < planes.corners_m_size(); ++i) {
    const double ax = planes.corners_m(6 * i), ay = planes.corners_m(6 * i + 1);
    const double ux = planes.corners_m(6 * i + 2) - ax, uy = planes.corners_m(6 * i + 3) - ay;
    const double share = std::clamp(((p.x - ax) * ux + (p.y - ay) * uy) / std::max(ux * ux + uy * uy, 1e-12), 0.0, 1.0);
    const double top = planes.corners_m(6 * i + 4), bottom = planes.corners_m(6 * i + 5);
    const double dz = p.z < top ? top - p.z : std::max(0.0, p.z - bottom);
    const double aside = std::hypot(ax + share * ux - p.x, ay + share * uy - p.y);
    if (std::hypot(aside, dz) <= radius_m + planes.margin_m(i)) return true;
  }
  return false;
}

// Whether near_m..far_m lies within the range that is presumed free in a cell of the profile.
inline bool presumed_free(const osape::v1::FreeProfile& free, int cell, int size, double near_m, double far_m) {
  const auto& from = free.open_from_dm();
  const auto& to = free.open_to_dm();
  if (from.size() != static_cast<size_t>(size) || to.size() != static_cast<size_t>(size)) return false;
  const float from_m = 0.1f * static_cast<unsigned char>(from[cell]), to_m = 0.1f * static_cast<unsigned char>(to[cell]);
  return near_m >= from_m && far_m <= to_m;
}

// Whether all of a ball lies in space that the camera observed to be free; with allow_open, or presumes to be free.
inline bool observed_free(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m, bool allow_open = false) {
  const auto& free = frame.free();
  const int directions = free.azimuth_edges_rad_size() - 1, layers = free.layer_edges_m_size() - 1;
  const int size = directions * layers;
  const double range = range_m(frame, p);
  if (directions < 1 || layers < 1 || free.free_from_m_size() != size || free.free_to_m_size() != size) return false;
  if (range <= radius_m) return false;
  double low, high;
  azimuths(frame, p, radius_m, &low, &high);
  int d0, d1, l0, l1;
  intervals(free.azimuth_edges_rad(), low, high, &d0, &d1);
  intervals(free.layer_edges_m(), p.z - radius_m, p.z + radius_m, &l0, &l1);
  if (d0 < 0 || d1 >= directions || l0 < 0 || l1 >= layers) return false;
  for (int d = d0; d <= d1; ++d) {
    for (int l = l0; l <= l1; ++l) {
      const int cell = d * layers + l;
      const double near_m = range - radius_m, far_m = range + radius_m;
      const bool measured = near_m >= free.free_from_m(cell) && far_m <= free.free_to_m(cell);
      if (!measured && !(allow_open && presumed_free(free, cell, size, near_m, far_m))) return false;
    }
  }
  return true;
}

// Horizontal distance in metres from (x, y) to the nearest plane, its margin subtracted; infinity without planes, 0 from a place
// that is not a position.
inline double nearest_plane_m(const osape::v1::Planes& planes, double x, double y) {
  if (!is_position({x, y, 0.0})) return 0.0;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < planes.margin_m_size() && 6 * i + 5 < planes.corners_m_size(); ++i) {
    const double ax = planes.corners_m(6 * i), ay = planes.corners_m(6 * i + 1);
    const double ux = planes.corners_m(6 * i + 2) - ax, uy = planes.corners_m(6 * i + 3) - ay;
    const double length2 = std::max(ux * ux + uy * uy, 1e-12);
    const double share = std::clamp(((x - ax) * ux + (y - ay) * uy) / length2, 0.0, 1.0);
    least = std::min(least, std::hypot(ax + share * ux - x, ay + share * uy - y) - planes.margin_m(i));
  }
  return least;
}

// Occupancy of a ball in a frame whose numbers fit together.
inline Occupancy occupancy_in(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m, bool allow_open) {
  if (touches_plane(frame, p, radius_m) || touches_ground(frame, p, radius_m)) return Occupancy::kOccupied;
  if (!clear_of_ground(frame, p, radius_m)) return Occupancy::kUnknown;
  if (observed_free(frame, p, radius_m)) return Occupancy::kFree;
  return allow_open && observed_free(frame, p, radius_m, true) ? Occupancy::kOpen : Occupancy::kUnknown;
}

// Occupancy of a ball that moves from one point to another along a straight line, in the message's frame: that of balls kWayStepM
// apart, each larger by half of that, which cover the way. Occupied where one of them is, else unknown where one is, else open where
// one is, else free. A position that is not finite or is beyond kMostM, a radius that is not finite and a negative one are occupied; if
// the frame is not valid, or its numbers do not fit together, everything else is unknown. kOpen is returned only with allow_open.
inline Occupancy segment_occupancy(const osape::v1::PrismsFrame& frame, const Point& from, const Point& to, double radius_m,
                                   bool allow_open = false) {
  if (!is_position(from) || !is_position(to) || !std::isfinite(radius_m) || radius_m < 0.0) return Occupancy::kOccupied;
  if (!usable(frame) || !numbers_fit(frame)) return Occupancy::kUnknown;
  const double dx = to.x - from.x, dy = to.y - from.y, dz = to.z - from.z, length_m = std::hypot(dx, dy, dz);
  const int steps = static_cast<int>(std::min(std::ceil(length_m / kWayStepM), kMostWaySteps));
  const double ball_m = steps > 0 ? radius_m + 0.5 * length_m / steps : radius_m;
  Occupancy found = Occupancy::kFree;
  for (int i = 0; i <= steps; ++i) {
    const double share = steps > 0 ? static_cast<double>(i) / steps : 0.0;
    const Point p{from.x + share * dx, from.y + share * dy, from.z + share * dz};
    const Occupancy at = occupancy_in(frame, p, ball_m, allow_open);
    if (at == Occupancy::kOccupied) return at;
    if (at == Occupancy::kUnknown || found == Occupancy::kFree) found = at;
  }
  return found;
}

// The same of a ball that does not move.
inline Occupancy occupancy(const osape::v1::PrismsFrame& frame, const Point& p, double radius_m, bool allow_open = false) {
  return segment_occupancy(frame, p, p, radius_m, allow_open);
}

}  // namespace osape_client
