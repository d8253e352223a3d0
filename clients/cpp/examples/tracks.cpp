// Prints the tracked obstacles of a message (osape.v1.Tracks) from standard input, and where moving ones are 0.5 s later.
#include <cstdio>
#include <iostream>

#include "osape_client/tracks.h"

int main() {
  osape::v1::Tracks message;
  const auto tracks = message.ParseFromIstream(&std::cin) ? osape_client::tracks_of(message) : std::nullopt;
  if (!tracks) {
    std::fputs("not a message of tracked obstacles\n", stderr);
    return 1;
  }
  for (const auto& t : *tracks) {
    std::printf("track %llu a %.3f %.3f b %.3f %.3f margin %.3f confidence %.3f state %d\n",
                static_cast<unsigned long long>(t.id), t.ax_m, t.ay_m, t.bx_m, t.by_m, t.margin_m, t.confidence,
                static_cast<int>(t.state));
  }
  for (const auto& o : message.objects()) {
    const auto at = osape_client::predicted(o, 0.5);
    std::printf("moving %llu at %.3f %.3f sigma %.3f\n", static_cast<unsigned long long>(o.id()), at.x_m, at.y_m, at.sigma_m);
  }
  return 0;
}
