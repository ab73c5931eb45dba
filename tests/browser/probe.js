// Looks at the pictures of a panel of widgets from inside the page.
window.probe = (() => {
  let kernel = null; // stays so in Voila, which does not show its kernel
  const busy = () => kernel !== null && kernel.status !== 'idle';
  const pause = () => new Promise(resolve => setTimeout(resolve, 20));

  const pictures = panel =>
    [...panel.querySelectorAll('img, canvas')].filter(e => e.getBoundingClientRect().width > 20);

  // What is cheap to compare many times a second: a new picture has a new address.
  const address = e => (e.tagName === 'CANVAS' ? e.toDataURL() : e.src);
  const ready = e => e.tagName === 'CANVAS' || (e.complete && e.naturalWidth > 0);
  const glance = panel => pictures(panel).map(address).join('\n');

  // What counts: the pixels themselves.
  const pixels = async panel => {
    const painted = [];
    for (const picture of pictures(panel)) {
      if (picture.decode) await picture.decode();
      const canvas = document.createElement('canvas');
      canvas.width = picture.naturalWidth || picture.width;
      canvas.height = picture.naturalHeight || picture.height;
      canvas.getContext('2d').drawImage(picture, 0, 0);
      painted.push(canvas.toDataURL());
    }
    const bytes = new TextEncoder().encode(painted.join('\n'));
    const digest = await crypto.subtle.digest('SHA-256', bytes);
    return [...new Uint8Array(digest)].map(b => b.toString(16).padStart(2, '0')).join('');
  };

  // Measures the time from the next key press or click to a new picture [ms].
  let watched = null;
  const watch = panel => {
    const before = glance(panel);
    let pressed = null;
    const press = () => { pressed ??= performance.now(); };
    const kinds = ['keydown', 'click', 'change'];
    kinds.forEach(kind => document.addEventListener(kind, press, true));
    watched?.stop();
    watched = { ms: null };
    const timer = setInterval(() => {
      if (!pressed || glance(panel) === before || !pictures(panel).every(ready)) return;
      watched.ms = performance.now() - pressed;
      watched.stop();
    }, 4);
    watched.stop = () => {
      clearInterval(timer);
      kinds.forEach(kind => document.removeEventListener(kind, press, true));
    };
  };

  // That time, as soon as it is known; null if none came while the kernel was busy nor after [ms].
  const awaited = async patience => {
    for (let end = performance.now() + patience; performance.now() < end; await pause()) {
      if (watched.ms !== null) break;
      if (busy()) end = performance.now() + patience;
    }
    watched.stop();
    return watched.ms;
  };

  // Waits until the kernel is idle, and pictures and words have not changed for a while [ms].
  const steady = async (panel, quiet) => {
    const look = () => `${busy()}\n${glance(panel)}\n${panel.innerText}`;
    let seen = look(), since = performance.now();
    while (busy() || performance.now() - since < quiet) {
      await pause();
      if (look() === seen) continue;
      [seen, since] = [look(), performance.now()];
    }
  };

  // Every error and every line on stderr that a kernel sends, wherever Lab would show it.  A kernel
  // that has not loaded ipywidgets yet says that it knows no such comm when Lab first asks for it.
  const complaints = [];
  const complain = text => { if (!text.startsWith('No such comm')) complaints.push(text); };
  const listen = to => {
    kernel = to;
    kernel.iopubMessage.connect((_, { header, content }) => {
      if (header.msg_type === 'error') complain(`${content.ename}: ${content.evalue}`);
      if (header.msg_type === 'stream' && content.name === 'stderr') complain(content.text);
    });
  };

  return { pixels, watch, awaited, steady, listen, complaints };
})();
