"""The page an operator looks at: the only room that imports asyncio."""
