"""`himap verify`: whether code that changed gives the stored numbers."""

import click

from himap.app.cli.shared import debug


@click.command()
@click.option("--renew", is_flag=True, help="Store the numbers of today's code where they differ.")
@debug
def verify(renew):
    """Accept changed code that gives the numbers of former code.

    Small calls are made of every product, method and beam whose code changed, and compared with the numbers
    in book/results/probes.json. Where they agree, stamps of notebooks, stored results and the cache stay
    valid: book/results/accepted.json says so, and is committed. Where they differ, what former code made is
    stale; with --renew later code is compared with today's. What chapters do in cells of their own is not
    called: `himap run --stale` executes those, and changes no more than the stamp if nothing else moved.

    \b
    himap verify && himap run --stale
    """
    # Imported here: other commands need not wait for all methods.
    from himap.paper.canonical import CALLS, RTOLS
    from himap.store.verify import verify as accept

    if accept(CALLS, rtols=RTOLS, renew=renew, report=click.echo) and not renew:
        raise SystemExit(1)
