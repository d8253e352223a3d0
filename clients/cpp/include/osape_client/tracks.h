// Tracked obstacles of one camera (osape.v1.Tracks). They are additional: where no track is, nothing is known to be free.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "osape_v1.pb.h"

namespace osape_client {

// A vertical rectangle from a to b, in the frame of the message; top < bottom (z down). Free space lies on the right of
// a -> b seen from above. margin_m: to be subtracted from the space in front; object_id: of its moving obstacle, 0: static.
struct Track {
  std::uint64_t id;
  float ax_m, ay_m, bx_m, by_m, top_m, bottom_m;
  float margin_m, sigma_m, confidence;
  osape::v1::Tracks::State state;
  std::uint32_t hits, flags;
  double age_s, unseen_s;
  std::uint64_t object_id;
};

inline bool finite_and_not_negative(const google::protobuf::RepeatedField<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value) && value >= 0.0f; });
}

// Whether the place, velocity and size of a moving obstacle are finite, and its size and standard deviations not negative.
inline bool fits(const osape::v1::MovingObstacle& o) {
  const auto &at = o.centre_m(), &half = o.half_size_m();
  const std::array<double, 6> place{at.x(), at.y(), at.z(), o.velocity_x_m_s(), o.velocity_y_m_s(), o.covariance_m2_s()};
  const std::array<double, 5> sizes{half.x(), half.y(), half.z(), o.position_sigma_m(), o.velocity_sigma_m_s()};
  return std::all_of(place.begin(), place.end(), [](double value) { return std::isfinite(value); }) &&
         std::all_of(sizes.begin(), sizes.end(), [](double value) { return std::isfinite(value) && value >= 0.0; });
}

// Whether numbers are of the range of the client in Python: greater ones are of a damaged message.
inline bool whole_numbers_fit(const osape::v1::Tracks& m) {
  const auto id_fits = [](std::uint64_t id) { return id <= 0x7fffffffffffffffu; };
  return std::all_of(m.id().begin(), m.id().end(), id_fits) &&
         std::all_of(m.object_id().begin(), m.object_id().end(), id_fits) &&
         std::all_of(m.hits().begin(), m.hits().end(), [](std::uint32_t hits) { return hits <= 0x7fffffffu; });
}

// The tracks of a message; nothing where its parts do not fit together, a number is not finite, or a margin is negative. Where
// m.left_out() is not 0, the service had no room for all: take the obstacles of the PrismsFrame.
inline std::optional<std::vector<Track>> tracks_of(const osape::v1::Tracks& m) {
  const int n = m.id_size();
  if (m.corners_m_size() != 6 * n || m.margin_m_size() != n || m.sigma_m_size() != n || m.confidence_size() != n ||
      m.state_size() != n || m.hits_size() != n || m.flags_size() != n || m.age_ns_size() != n ||
      m.unseen_ns_size() != n || m.object_id_size() != n) {
    return std::nullopt;
  }
  if (!whole_numbers_fit(m)) return std::nullopt;
  if (!finite_and_not_negative(m.margin_m()) || !finite_and_not_negative(m.sigma_m())) return std::nullopt;
  if (!std::all_of(m.objects().begin(), m.objects().end(), fits)) return std::nullopt;
  std::vector<Track> tracks;
  tracks.reserve(static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) {
    std::array<float, 6> c{};
    for (int i = 0; i < 6; ++i) {
      c[static_cast<std::size_t>(i)] = m.corners_m(6 * k + i);
      if (!std::isfinite(m.corners_m(6 * k + i))) return std::nullopt;
    }
    tracks.push_back({m.id(k), c[0], c[1], c[2], c[3], c[4], c[5], m.margin_m(k), m.sigma_m(k), m.confidence(k),
                      m.state(k), m.hits(k), m.flags(k), 1e-9 * static_cast<double>(m.age_ns(k)),
                      1e-9 * static_cast<double>(m.unseen_ns(k)), m.object_id(k)});
  }
  return tracks;
}

// Place of a moving obstacle some seconds after the exposure, at constant velocity, and its standard deviation on each axis.
struct Prediction {
  double x_m, y_m, z_m, sigma_m;
};

inline Prediction predicted(const osape::v1::MovingObstacle& o, double after_s) {
  const double p = o.position_sigma_m() * o.position_sigma_m(), v = o.velocity_sigma_m_s() * o.velocity_sigma_m_s();
  const double variance = p + 2.0 * after_s * o.covariance_m2_s() + after_s * after_s * v;
  return {o.centre_m().x() + after_s * o.velocity_x_m_s(), o.centre_m().y() + after_s * o.velocity_y_m_s(),
          o.centre_m().z(), std::sqrt(std::fmax(variance, 0.0))};
}

}  // namespace osape_client
