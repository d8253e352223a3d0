// Asks one message, a file with an osape.v1.PrismsFrame: for each line "x y z radius" on standard input an answer on a line
// of its own, 0 unknown, 1 free, 2 occupied. Usage: ask FILE
#include <fstream>
#include <iostream>

#include "space.h"

int main(int argc, char** argv) {
  osape::v1::PrismsFrame frame;
  std::ifstream file(argc > 1 ? argv[1] : "", std::ios::binary);
  if (!file || !frame.ParseFromIstream(&file)) {
    std::cerr << "usage: " << argv[0] << " FILE   with an osape.v1.PrismsFrame\n";
    return 2;
  }
  osape_space::Point p;
  for (double radius_m; std::cin >> p.x >> p.y >> p.z >> radius_m;) {
    std::cout << static_cast<int>(osape_space::ball(frame, p, radius_m)) << '\n';
  }
}
