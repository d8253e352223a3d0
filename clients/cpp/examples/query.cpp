// Queries one message, a file with an osape.v1.PrismsFrame. For each line "x y z radius" on standard input one line is
// printed: 0 unknown, 1 free, 2 occupied. Usage: query FILE
#include <fstream>
#include <iostream>

#include "osape_client/space.h"

int main(int argc, char** argv) {
  osape::v1::PrismsFrame frame;
  std::ifstream file(argc > 1 ? argv[1] : "", std::ios::binary);
  if (!file || !frame.ParseFromIstream(&file)) {
    std::cerr << "usage: " << argv[0] << " FILE   with an osape.v1.PrismsFrame\n";
    return 2;
  }
  osape_client::Point p;
  for (double radius_m; std::cin >> p.x >> p.y >> p.z >> radius_m;) {
    std::cout << static_cast<int>(osape_client::occupancy(frame, p, radius_m)) << '\n';
  }
}
