"""Print predictions as a Foxglove viewer gets them: ``python watch_foxglove.py
ws://127.0.0.1:8765/TOKEN/``."""

import asyncio
import json
import sys

import aiohttp

HEAD = 13  # opcode, subscription, time in ns


async def watch(url: str, count: int) -> None:
    """Subscribe to the predictions and print some of them."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=["foxglove.sdk.v1"]) as view,
    ):
        await view.receive_str()  # serverInfo
        channels = {
            channel["topic"]: channel["id"]
            for channel in json.loads(await view.receive_str())["channels"]
        }
        entries = [{"id": 1, "channelId": channels["/tactophone/prediction"]}]
        await view.send_str(json.dumps({"op": "subscribe", "subscriptions": entries}))
        for _ in range(count):
            prediction = json.loads((await view.receive_bytes())[HEAD:])
            print(
                f"{prediction['window_end']:.2f} s  {prediction['touch']:6} "
                f"{prediction['amplitude']}"
            )


asyncio.run(watch(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 100))
