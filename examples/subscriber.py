"""What a planner needs, in ten lines. Run beside the service: .venv/bin/python examples/subscriber.py [ADDRESS]"""

import sys

from companion.client import Client, News


def look(news: News) -> None:
    if news.stale or not news.valid:
        print(f"nothing may be taken as free: {news.cause or 'no news'} ({news.age_s:.1f} s old)", flush=True)
        return
    ahead = news.space.segments([[0, 0, 0]], [[5, 0, 0]], radius_m=0.5) if news.frame == "level" else []
    print(
        f"{news.frame}, {1000 * news.age_s:.0f} ms old; nearest {news.space.nearest([0, 0, 0])[0][0]:.1f} m",
        *ahead,
        flush=True,
    )


with Client(*sys.argv[1:]) as client:
    client.run(look)
