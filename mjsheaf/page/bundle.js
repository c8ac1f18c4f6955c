/*
three 0.180.0

The MIT License

Copyright © 2010-2025 three.js authors

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in
all copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN
THE SOFTWARE.


uplot 1.6.32

The MIT License (MIT)

Copyright (c) 2022 Leon Sorokin

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in
all copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN
THE SOFTWARE.
*/
(()=>{var di=[.05,.1,.25,.5,1,2,3,5,10,20,50,100],vg=40,gr=class extends EventTarget{constructor(t){super(),this.run=t,this.t=t.start,this.playing=!1,this.loop=!0;let e=Math.max(t.said.speed,(t.end-t.start)/vg);this.speed=di.find(n=>n>=e*.99)??di[di.length-1],this.speeds=di}seek(t){Number.isNaN(t)||(this.t=Math.min(Math.max(t,this.run.start),this.run.end),this.dispatchEvent(new Event("time")))}step(t){let[e,n]=this.run.locate(this.t),s=n>0&&t<0?e+1:e;this.pause(),this.seek(this.run.time[Math.min(Math.max(s+t,0),this.run.time.length-1)])}play(){this.run.end<=this.run.start||(this.t>=this.run.end&&this.seek(this.run.start),this.playing=!0,this.dispatchEvent(new Event("state")))}pause(){this.playing=!1,this.dispatchEvent(new Event("state"))}toggle(){this.playing?this.pause():this.play()}setSpeed(t){this.speed=Math.min(Math.max(t,di[0]),di[di.length-1]),this.dispatchEvent(new Event("state"))}change(t){let e=di.reduce((n,s,r)=>Math.abs(s-this.speed)<Math.abs(di[n]-this.speed)?r:n,0);this.setSpeed(di[Math.min(Math.max(e+t,0),di.length-1)])}setLoop(t){this.loop=t,this.dispatchEvent(new Event("state"))}advance(t){if(!this.playing)return;let e=this.t+t*this.speed;if(e<this.run.end)return this.seek(e);if(!this.loop)return this.seek(this.run.end),this.pause();let n=this.run.end-this.run.start;this.seek(this.run.start+(e-this.run.start)%n)}};function id(){return Object.fromEntries(new URLSearchParams(location.hash.slice(1)))}function sd(i){let t="#"+new URLSearchParams(i).toString().replaceAll("%2C",",");try{history.replaceState(null,"",t)}catch{}}async function rd(){let i=JSON.parse(document.getElementById("said").textContent),t=Uint8Array.from(atob(document.getElementById("data").textContent.trim()),s=>s.charCodeAt(0)),e=new Blob([t]).stream().pipeThrough(new DecompressionStream("deflate")),n=new Uint8Array(await new Response(e).arrayBuffer());return new Fc(i,n)}var Mg=-(2**31);function bg(i,{shape:[t,e],at:n,step:s}){let r=t*e,o=new Float32Array(r),a=new Int32Array(1),c=new Float32Array(a.buffer);for(let l=0,h=n;l<e;l++){let u=0;for(let d=0;d<t;d++,h++){let f=i[h]|i[h+r]<<8|i[h+2*r]<<16|i[h+3*r]<<24;u=u+(f>>>1^-(f&1))|0,a[0]=u,o[d*e+l]=s?u===Mg?NaN:u*s:c[0]}}return o}var Fc=class{constructor(t,e){this.said=t,this.time=Float64Array.from(t.time),this.agents=t.agents.length,this.names=[...t.agents,...t.targets],this.vehicles=this.names.length,this.series={};for(let[n,s]of Object.entries(t.arrays))this.series[n]=bg(e,s);this.columns=n=>t.arrays[n].shape[1],this.start=this.time[0],this.end=this.time[this.time.length-1],this.events=t.phases.filter(n=>n.events.length),this.groupOf=t.group}limit(t,e){return this.said.limits.findLast(({time:n},s)=>s===0||n<=this.time[t]+1e-9).limit[e]}most(t,e){let n=[this.said.fastest[e],this.limit(t,e)].filter(s=>s!==null&&Number.isFinite(s));return n.length?Math.min(...n):null}locate(t){let{time:e}=this,n=0,s=e.length-1;if(t>=e[s])return[s,0];for(;s-n>1;){let r=n+s>>1;e[r]<=t?n=r:s=r}return[n,Math.max(0,(t-e[n])/(e[s]-e[n]))]}at(t,e,n,s=0,r=this.columns(t)){let[o,a]=this.locate(e),c=this.series[t],l=this.columns(t),h=o*l+s,u=a>0?h+l:h;for(let d=0;d<r;d++){let f=c[h+d],g=c[u+d];n[d]=a===0||Number.isNaN(g)?f:Number.isNaN(f)?g:f+a*(g-f)}return n}value(t,e,n){return this.series[t][this.locate(e)[0]*this.columns(t)+n]}present(t,e){return!Number.isNaN(this.series.tracking_error[t*this.agents+e])}keptFrom(t,e){let n=this.series.cause?.[t*this.agents+e]??0;return n>this.vehicles?this.said.obstacles[n-this.vehicles-1].id:this.names[n-1]??""}column(t,e){let n=this.series[t],s=this.columns(t),r=new Array(this.time.length);for(let o=0;o<r.length;o++){let a=n[o*s+e];r[o]=Number.isFinite(a)?a:null}return r}over(t,e,n){let s=this.series[t],r=this.columns(t),o=new Array(this.time.length),a=[];for(let c=0;c<o.length;c++){a.length=0;for(let l of e){let h=s[c*r+l];Number.isFinite(h)&&a.push(h)}a.length?n==="mean"?o[c]=a.reduce((l,h)=>l+h,0)/a.length:n==="rms"?o[c]=Math.sqrt(a.reduce((l,h)=>l+h*h,0)/a.length):o[c]=a.sort((l,h)=>l-h)[Math.round(n*(a.length-1))]:o[c]=null}return o}worst(t){let e=-1,n=-1;for(let s=0;s<this.agents;s++){let r=this.series.tracking_error[t*this.agents+s];r>n&&([e,n]=[s,r])}return e}};function fo(i){return i<0||Object.is(i,-0)}function Yt(i){if(i==null||Number.isNaN(i))return"\u2013";if(!Number.isFinite(i))return i>0?"\u221E":"\u2212\u221E";let t=Math.abs(i);return t===0?"0":t>=1e5||t<.001?i.toExponential(1).replace("-","\u2212"):i.toFixed(Math.max(0,2-Math.floor(Math.log10(t)))).replace("-","\u2212")}function od(i,t){let[e,n,s]=[1,3,5].map(c=>parseInt(i.slice(c,c+2),16)),r=(.21*e+.72*n+.07*s)/255,o=t?Math.max(0,.42-r):Math.max(0,r-.66)*1.6,a=t?255:0;return`rgb(${[e,n,s].map(c=>Math.round(c+o*(a-c))).join(", ")})`}function ad(i){let t=10**Math.floor(Math.log10(i));return t*[5,2,1].find(e=>e*t<=i*(1+1e-9))}function st(i,t="",...e){let n=document.createElement(i);return t&&(n.className=t),n.append(...e.filter(s=>s!=null)),n}var Ns=i=>document.getElementById(i),nn=i=>st("bdi","",i),Sg={settled:"The errors have settled.","not settled":"The team has not settled at the end.",diverging:"The errors grow to the end."},ld={mean_disagreement:["disagreement","mean over agents"],tracking_error:["from its place","RMS over agents"],formation_error:["formation","RMS over links"],centering_error:["centering","largest of a group"]},cd=.8,wg=.1,Eg=.2,Oc=20,Tg=.05;function hd(i,t){let[e,n]=[Math.hypot(...i),Math.hypot(...t)];return e>1e-6&&n>Tg?i.reduce((s,r,o)=>s+r*t[o],0)/e/n:0}function pd(i,t,e){let{said:n,series:s}=i,r=[];if(!i.present(t,e))return["lost"];let o=U=>s[U]?.[t*i.agents+e],a=i.keptFrom(t,e);a&&r.push(`the filter keeps it from ${a}`);let[c,l,h]=[o("speed"),n.fastest[e],i.limit(t,e)];h!==null&&c>=.99*h&&r.push(`asks for its speed limit of ${Yt(h)} m/s`),l!==null&&c>l&&r.push(`asks for ${Yt(c)} m/s, its all-way speed is ${Yt(l)}`),o("saturation")>=.5&&r.push("thrusters at their limits");let u=Math.hypot(...s.flow.subarray((t*i.agents+e)*3,(t*i.agents+e)*3+3));l!==null&&u>l&&r.push(`the flow of ${Yt(u)} m/s is beyond its all-way speed`);let d=(U,S)=>Array.from(s[U].subarray(S*i.columns(U)+3*e,S*i.columns(U)+3*e+3)),[f,g,x]=[d("position",t),d("q_star",t),d("flow",t)],[m,p]=[Math.max(t-1,0),Math.min(t+1,i.time.length-1)],w=d("q_star",p).map((U,S)=>(U-d("q_star",m)[S])/(i.time[p]-i.time[m]||1)),E=g.map((U,S)=>U-f[S]);!i.events.some(({time:U})=>U>i.time[m]&&U<=i.time[p])&&hd(E,w)>cd?r.push(`lags behind its place, which moves at ${Yt(Math.hypot(...w))} m/s`):hd(E,x)<-cd&&r.push(`carried off by the flow of ${Yt(Math.hypot(...x))} m/s`);let C=n.edges.length,A=n.edges.map((U,S)=>[U,s.residual?.[t*C+S]]).filter(([U,S])=>(U.tail===e||U.head===e)&&!Number.isNaN(S)),D=A.filter(([,U])=>fo(U)).length;return A.length?D&&r.push(`${D} of its ${A.length} links silent`):r.push("has no links"),r.concat(Ag(i,t,e,Math.hypot(...E)))}function Ag(i,t,e,n){let s=o=>Array.from(i.series.q_star.subarray((o*i.agents+e)*3,(o*i.agents+e)*3+3)),r=[];for(let{time:o,events:a}of i.events){if(o<=i.start||o>i.time[t]||i.time[t]-o>=wg*(i.end-i.start))continue;let c=i.time.findIndex(g=>g>=o-1e-9);if(c<2)continue;let[l,h,u]=[s(c-2),s(c-1),s(c)],d=(i.time[c]-i.time[c-1])/(i.time[c-1]-i.time[c-2]),f=Math.hypot(...u.map((g,x)=>g-h[x]-d*(h[x]-l[x])));f>Eg*n&&r.push(`its place jumped by ${Yt(f)} m at ${Yt(o)} s: ${a.join(", ")}`)}return r}function po(i,t=i.said.facts.law){let{facts:e}=i.said;document.title=`${e.scenario}: mjsheaf run`,Ns("title").textContent=e.scenario,Ns("subtitle").title=e.summary||"",Ns("subtitle").replaceChildren(nn(e.summary||""),e.summary?" \xB7 ":"",`${e.backend}, ${t}`)}function md(i,t){let{facts:e}=i.said;po(i);let n=Ns("worst");if(e.status!=="finished"){n.append(st("strong","bad","Blew up"),` at ${Yt(i.end)} s. `,nn(e.message||""));return}let s=i.locate((i.start+i.end)/2)[0],r=i.over("tracking_error",[...i.said.agents.keys()],"rms"),o=r[r.length-1];o!==null&&n.append(st("strong","headline",`RMS over agents: ${Yt(o)} m`)," from their places at the end. ");let[a,c,l]=[0,-1,-1];for(let d=s;d<i.time.length;d++){let f=i.worst(d),g=f<0?-1:i.series.tracking_error[d*i.agents+f];g>l&&([a,c,l]=[d,f,g])}if(c<0)return;let h=st("button","link",nn(i.names[c]),`, ${Yt(l)} m from its place at ${Yt(i.time[a])} s`);h.title="Go there",h.addEventListener("click",()=>t(i.time[a],c));let u=pd(i,a,c);n.append("Farthest off in the second half: ",h,u.length?`: ${u.join("; ")}.`:".")}var ha=class{constructor(t,e){this.run=t,this.home=Ns("card"),this.name=st("bdi","name"),this.role=st("span","role"),this.rows=st("dl"),this.why=st("p","why");let n=st("button","","Follow");n.addEventListener("click",()=>e(this.vehicle)),this.brief=st("span","brief"),this.details=st("details","",st("summary","",this.name,this.brief),st("div","top",this.role,n),this.rows,this.why),this.details.open=!matchMedia("(max-width: 760px)").matches,this.home.append(this.details),this.said=""}show(t,e,n){let{run:s}=this,r=e>=0?e:n;if(this.vehicle=r,this.home.hidden=r<0,r<0)return;let[o]=s.locate(t),a=[],{said:c,series:l}=s,h=[];if(r<s.agents){let f=m=>l[m]?.[o*s.agents+r],g=(o*s.agents+r)*3;a.push(["from its place",`${Yt(f("tracking_error"))} m`],["disagreement",`${Yt(f("disagreement"))} m`]);let x=s.most(o,r);a.push(["asks for, m/s",`${Yt(f("speed"))}${x===null?"":` of ${Yt(x)}`}`]),a.push(["flow about it, m/s",Yt(Math.hypot(l.flow[g],l.flow[g+1],l.flow[g+2]))]),l.saturation&&a.push(["thrusters at a limit",`${Math.round(100*f("saturation"))} %`]),l.cause&&a.push(["filter changes, m/s",Yt(f("correction"))]),l.apart&&a.push(["from its ideal twin",`${Yt(f("apart"))} m`]),h=pd(s,o,r)}else a.push(["","a target: it does not cooperate"]);let u=r<s.agents?`${Yt(l.tracking_error[o*s.agents+r])} m off`:"target",d=JSON.stringify([r,e>=0,a,h,u]);d!==this.said&&(this.said=d,this.name.textContent=s.names[r],this.brief.textContent=u,this.name.style.setProperty("--own",c.groups[s.groupOf[r]].colour),this.role.replaceChildren(nn(c.kinds[c.kind[r]].name),", ",e>=0?nn(c.groups[s.groupOf[r]].name):"farthest off now"),this.rows.replaceChildren(...a.flatMap(([f,g])=>[st("dt","",f),st("dd","",g)])),this.why.textContent=h.join("; "))}};function gd(i,t){let e=Ns("legend"),n=(c,l="swatch")=>{let h=st("i",l);for(let[u,d]of Object.entries(c))h.style.setProperty(u,d);return h},s=(c,...l)=>st("div","row",c,st("span","",...l)),o=[...new Set(i.groupOf)].slice(0,9).map(c=>s(n({background:i.said.groups[c].colour},c===i.groupOf[i.agents]?"swatch target":"swatch"),nn(i.said.groups[c].name)));o.push(s(st("i","goal"),"where an agent should be, q*"));for(let{name:c,colour:l}of i.said.ghosts)o.push(s(l?n({background:l},"ghost"):st("i","ghost"),"translucent: ",nn(c)));i.said.edges.length&&(t.rangeSaid=st("span","",Bc(t)),o.push(s(st("i","bar"),t.rangeSaid)),i.said.edges.some(({kind:c})=>c==="sensing")&&o.push(s(st("i","dashed"),i.said.edges.some(({kind:c,directed:l})=>c!=="sensing"&&!l)?"sees a target (solid: agents talk)":"sees a target")),i.said.edges.some(({kind:c,directed:l})=>c!=="sensing"&&l)&&o.push(s(st("i","one-way"),"one agent senses another, one way")),i.series.residual.some(fo)&&o.push(s(st("i","silent"),"grey: silent"))),i.series.cause&&o.push(s(st("i","kept"),"the filter keeps the agent at the tip away from the other end")),i.said.obstacles.length&&o.push(s(st("i","swatch obstacle"),"obstacle"));for(let{name:c,scale:l,top:h}of i.said.flow){let u=st("div","speeds",st("span","","0"),st("i",`flow${l}`),st("span","",`${Yt(h).replace(/\.?0+$/,"")} m/s`));o.push(s(st("i",`arrow flow${l}`),`speed of the ${c}`,u))}t.larger=st("span",""),o.push(s(st("i","larger","\u2197"),t.larger));let a=st("details","",st("summary","","Legend"),st("div","",...o));a.open=!matchMedia("(max-width: 760px)").matches,e.append(a)}function Bc(i){let[t,e]=i.residualRange;return`link, blue to red: ${Yt(t)} to ${Yt(e)} m off`}function _d(i,t){let{facts:e,notes:n}=i.said,s=Ns("facts"),r=(h,...u)=>{let d=st("article","",st("h2","",h),...u);return s.append(d),d},o=(h,u=-1)=>{let d=st("button","link",`${Yt(h)} s`);return d.addEventListener("click",()=>t(h,u)),d};if(i.said.live){r("How it is made",ud(i));return}let a=e.status==="finished"?Sg[e.ending]??"The run came to its end.":`The run blew up: ${e.message}`,c=st("ul");for(let h of n){let u=h.agent===void 0||h.agent===null?-1:i.names.indexOf(h.agent);c.append(st("li","",nn(h.text),h.time===void 0||h.time===null?null:st("span",""," ",o(h.time,u))))}r("What happened",st("p",e.status==="finished"?"":"bad",nn(a)),Rg(e.safety),n.length?c:null,Cg(i,o)),r("At the end",Pg(e)),r("Does the theory hold",...Ig(e,o)),r("Agents",Lg(i,t));let l=ud(i);l.append(st("dt","","samples"),st("dd","",`${i.time.length} of ${i.said.samples} are kept here; no vehicle is shown more than ${Yt(i.said.largest_error)} m from where result.nc has it at any sample`)),r("How it was made",l)}function ud({said:{facts:i}}){let t=st("dl"),e=(n,...s)=>t.append(st("dt","",n),st("dd","",...s));for(let[n,s]of Object.entries(i.versions))e(n,nn(s));return e("seed",String(i.seed)),e("again",st("code","",i.command),i.where),t}function Rg(i){if(!i)return null;let t=i.smallest_separation,e=Object.entries(i.filtered).sort(([,s],[,r])=>r-s),n=[];return t!==null&&n.push(t<0?st("strong","bad",`Too close: ${Yt(-t)} m below the distance to keep. `):`Vehicles kept their distance, with ${Yt(t)} m to spare at the closest. `),e.length&&n.push("The filter acted most on ",nn(e[0][0]),`, ${Yt(100*e[0][1])} % of the time. `),i.deadlocked.length&&n.push(st("strong","bad","Deadlocked at the end: "),nn(i.deadlocked.join(", ")),"."),st("p","",...n)}function Cg(i,t){if(!i.events.length)return null;let e=st("ul");for(let n of i.events)e.append(st("li","",t(n.time)," ",nn(n.events.join(", "))));return e}function xd(i,t){let e=st("tr");for(let o of i)e.append(st("th","",...[o].flat()));e.querySelectorAll("th").forEach(o=>o.setAttribute("scope","col"));let n=st("div","wide",st("table","",st("thead","",e),st("tbody","",...t))),s=st("small","hint","there are more columns: scroll sideways \u2192");s.hidden=!0;let r=()=>{let o=n.scrollWidth>n.clientWidth+1,a=n.scrollLeft+n.clientWidth>=n.scrollWidth-1;s.hidden=!o,n.classList.toggle("cut",o&&!a),o?n.tabIndex=0:n.removeAttribute("tabindex")};return new ResizeObserver(r).observe(n),n.addEventListener("scroll",r,{passive:!0}),st("div","table",s,n)}function Pg(i){let t=Object.fromEntries(i.expect.map(s=>[s.measure,s])),e=i.final.map(([s,...r])=>{let o=r.map((a,c)=>{let l=s==="team"?t[i.measures[c]]:null,h=st("td",l?l.met?"good":"bad":"",Yt(a));return l&&h.append(st("small","",l.met?` \u2713 at most ${Yt(l.bound)}`:` \u2717 expected at most ${Yt(l.bound)}`)),h});return st("tr","",st("th","",nn(s)),...o)}),n=i.measures.map(s=>[ld[s][0],st("small","",ld[s][1])]);return xd(["errors, m",...n],e)}function Ig(i,t){let[e,...n]=i.theory,s=dd(e),r=[st("ul","verdicts",...s.map(fd))];for(let o of n){let a=dd(o),c=a.filter(({text:h,why:u},d)=>h!==s[d].text||u!==s[d].why),l=st("h3","","From ",t(o.time),": ",nn(o.events.join(", ")));r.push(l,c.length?st("ul","verdicts",...c.map(fd)):st("p","","All as before.")),s=a}return r}function dd({assumptions:i,theorem:t,held:e}){return[...i.map(({number:n,name:s,verdict:r,why:o})=>({verdict:r,text:`Assumption ${n}, ${s}: ${r}`,why:r==="holds"?"":o})),t.applies?{verdict:"holds",text:`Theorem 1 bounds the error${t.approximate?", approximately":""}`,why:""}:{verdict:"undecided",text:"Theorem 1 does not apply:",why:t.reason},e.applies?{verdict:"holds",text:"The bound of the held law applies",why:""}:{verdict:"undecided",text:"No bound of the held law:",why:e.reason}]}function fd({verdict:i,text:t,why:e}){let[n,s]={holds:["\u2713 ","good"],fails:["\u2717 ","bad"],undecided:["? ",""]}[i]??["\u2013 ",""];return st("li",s,st("b","",n),t,e?st("small",""," ",nn(e)):null)}function Lg(i,t){let e=i.time.length-1,n=i.said.agents.map((o,a)=>{let[c,l]=[-1,0];for(let h=i.locate((i.start+i.end)/2)[0];h<=e;h++){let u=i.series.tracking_error[h*i.agents+a];u>c&&([c,l]=[u,h])}return{name:o,i:a,most:c,at:l,end:i.series.tracking_error[e*i.agents+a]}});n.sort((o,a)=>a.most-o.most);let s=n.slice(0,Oc).map(({name:o,i:a,most:c,at:l,end:h})=>{let u=st("button","link",nn(o));return u.addEventListener("click",()=>t(i.time[l],a)),st("tr","",st("th","",u),st("td","",nn(i.said.groups[i.groupOf[a]].name)),st("td","",nn(i.said.kinds[i.said.kind[a]].name)),st("td","",c<0?"\u2013":Yt(c)),st("td","",c<0?"\u2013":Yt(i.time[l])),st("td","",Yt(h)))}),r=xd(["agent","group","vehicle","farthest off, m","when, s","at the end, m"],s);return n.length>Oc&&r.append(st("p","",`The ${Oc} of ${n.length} that are farthest off in the second half.`)),r}var Dg=6e5,Ng=300,Ug=.06,Fg=.03,kc=200,Og=3,zc=20,Bg=5,ua=class extends gr{constructor(t){super(t),this.speeds=[...t.said.live.speeds,1/0],this.speed=1,this.follow=!0,this.paused=!1,this.drawn=!1,this.slow=!1,this.send=()=>{}}get playing(){return this.follow&&!this.paused}set playing(t){}seek(t){this.follow=t>=this.run.end,super.seek(t),this.dispatchEvent(new Event("state"))}catchUp(){this.seek(this.run.end)}toggle(){this.follow?this.send({pause:!this.paused}):this.catchUp()}pause(){}setSpeed(t){this.send({speed:Number.isFinite(t)?t:null})}change(t){let e=this.speeds.indexOf(this.speed)+t;this.speeds[e]!==void 0&&this.setSpeed(this.speeds[e])}advance(t){if(this.drawn&&(this.slow=t>Fg),this.drawn=this.follow&&this.t<this.run.end,!this.drawn)return;let e=this.slow?0:(this.run.end-this.t)*Math.exp(-t/Ug);this.t=e<1e-4?this.run.end:this.run.end-e,this.dispatchEvent(new Event("time"))}};function kg(i,t){let e=new DataView(t).getFloat64(0,!0);if(e<=i.end)return!1;let n=new Float32Array(t.slice(8));i.time.length>=i.room&&Vg(i);let s=i.time.length,r=0;for(let o of Object.keys(i.said.arrays)){let a=i.columns(o);i.series[o].length<(s+1)*a&&(i.series[o]=zg(i.series[o],s*a,i.room*a)),i.series[o].set(n.subarray(r,r+a),s*a),r+=a}return i.said.time.push(e),i.time=Float64Array.from(i.said.time),i.end=e,!0}function zg(i,t,e){let n=new Float32Array(e);return n.set(i.subarray(0,t)),n}function Vg(i){let t=i.said.time.map((e,n)=>n).filter(e=>e%2===0);for(let e of Object.keys(i.said.arrays)){let n=i.columns(e);t.forEach((s,r)=>i.series[e].copyWithin(r*n,s*n,(s+1)*n))}i.said.time=t.map(e=>i.said.time[e]),i.time=Float64Array.from(i.said.time)}function vd(i,t,e,n,s){let{live:r}=i.said,o=Math.max(...Object.keys(i.said.arrays).map(f=>i.columns(f)));i.room=Math.max(Math.min(4e3,Math.floor(Dg/o)),2*i.time.length);let a=new URLSearchParams(location.search).get("token"),c=new WebSocket(`${r.address}?token=${encodeURIComponent(a)}`);c.binaryType="arraybuffer";let l=f=>c.readyState===WebSocket.OPEN&&c.send(JSON.stringify(f));t.send=l;let h=new Vc(i,t,l),u=0;c.addEventListener("message",({data:f})=>{typeof f=="string"?(h.show(JSON.parse(f)),s.mark(),e?.flowChanged()):kg(i,f)&&(e?.extend(),performance.now()-u>Ng&&(u=performance.now(),n.extend(),Hg(e))),s.show()});let d=!1;return c.addEventListener("open",()=>d=!0),c.addEventListener("close",()=>{n.extend(),h.disconnect(d)}),h}function Hg(i){i?.rangeSaid&&(i.rescale(),i.rangeSaid.textContent=Bc(i))}var Vc=class{constructor(t,e,n){Object.assign(this,{run:t,clock:e,send:n});let{live:s}=t.said;this.status=document.getElementById("worst"),this.status.setAttribute("role","status"),this.problem=st("p","bad"),this.problem.setAttribute("role","alert"),this.done=st("ol"),this.agent=yd("Agent",s.agents.map(l=>[l,l])),this.link=yd("Link",s.links.map(l=>[JSON.stringify(l),l.join(" \u2013 ")]));let r=new da("Gain",kc,{valueOf:l=>+(s.gain*s.factor**(2*l/kc-1)).toPrecision(4),placeOf:l=>(Math.log(l/s.gain)/Math.log(s.factor)+1)*kc/2,words:l=>`${Yt(l)} 1/s`,changed:l=>n({gain:l})}),o=new da("Flow",Og*zc,{valueOf:l=>l/zc,placeOf:l=>l*zc,words:l=>`${Yt(l)} \xD7`,changed:l=>n({flow:l})});this.sliders={gain:r,flow:o},this.limit=st("p","limit");let a=[r.row,this.limit,s.flow?o.row:null];a.push(st("div","pick",st("label","","Agent ",this.agent),this.button("Lose",()=>({lose:this.agent.value})),this.button("Join",()=>({join:this.agent.value})))),s.links.length&&a.push(st("div","pick",st("label","","Link ",this.link),this.button("Cut",()=>({cut:JSON.parse(this.link.value)})),this.button("Restore",()=>({restore:JSON.parse(this.link.value)}))));let c=st("details","",st("summary","","Change the run"),...a,this.problem,st("b","","Done so far"),this.done);c.open=!0,this.box=st("div","panel",c),this.box.id="live",document.getElementById("legend").after(this.box),this.show({paused:!1,ended:!1,speed:1,message:"",phases:[],absent:[],flow:[],done:[]})}button(t,e){let n=st("button","",t);return n.addEventListener("click",()=>this.send(e())),n}choose(t){t>=0&&t<this.run.agents&&(this.agent.value=this.run.names[t])}show(t){let{run:e,clock:n}=this;this.state=t,n.paused=t.paused||t.ended,n.speed=t.speed??1/0,n.dispatchEvent(new Event("state")),e.events=t.phases,e.said.phases=t.phases;for(let a of e.said.flow){a.first??=a.changes;let c=({time:l,factor:h})=>({time:l,velocity:a.velocity.map(u=>u.map(d=>h*d))});a.changes=[...a.first,...t.flow.map(c)].sort((l,h)=>l.time-h.time)}this.problem.textContent=t.message;let s=t.done.length?t.done:["nothing yet"];this.done.replaceChildren(...s.slice(-Bg).map(a=>st("li","",st("bdi","",a))));for(let a of this.agent.options)a.textContent=a.value+(t.absent.includes(a.value)?" (lost)":"");let r=t.gain??e.said.live.gain;this.sliders.gain.show(r),this.sliders.gain.mark(t.stable_gain);let o=Number.isFinite(t.stable_gain);this.limit.textContent=o?`${r<t.stable_gain?"stable below":"unstable from"} ${Yt(t.stable_gain)} 1/s${r<t.stable_gain?"":" on"}`:"",this.limit.classList.toggle("bad",o&&r>=t.stable_gain),t.law&&po(e,t.law),this.sliders.flow.show(t.flow.at(-1)?.factor??1),this.tell()}tell(){let{state:t}=this,e=this.closed?"Disconnected":t.ended?"Ended":t.paused?"Paused":"Running",n=this.closed??(t.ended?"Close this page to end the server; what you did is recorded as a scenario.":`${t.paused?"":`until ${+this.run.said.live.end.toFixed(3)} s. `}Closing this page ends the run; what you do is recorded as events of a scenario.`);this.status.replaceChildren(st("strong",this.closed?"bad":"headline",e),` ${n}`)}disconnect(t){this.closed=t?"The run was ended.":"Another page controls this run, or it has ended.",this.clock.paused=!0;for(let e of this.box.querySelectorAll("button, select, input"))e.disabled=!0;this.clock.dispatchEvent(new Event("state")),this.tell()}};function yd(i,t){let e=document.createElement("select");return e.setAttribute("aria-label",i),e.append(...t.map(([n,s])=>new Option(s,n))),e}var da=class{constructor(t,e,{valueOf:n,placeOf:s,words:r,changed:o}){Object.assign(this,{placeOf:s,words:r}),this.input=Object.assign(document.createElement("input"),{type:"range",min:0,max:e,step:1}),this.input.setAttribute("aria-label",t),this.output=document.createElement("output"),this.input.addEventListener("input",()=>this.output.textContent=r(n(+this.input.value))),this.input.addEventListener("change",()=>o(n(+this.input.value))),this.tick=Object.assign(st("i"),{hidden:!0}),this.row=st("label","slider",st("span","",t),st("div","",this.input,this.tick),this.output)}mark(t){let e=this.placeOf(t)/this.input.max;this.tick.hidden=!(e>=0&&e<=1),this.tick.style.left=`calc(8px + ${e} * (100% - 16px))`}show(t){this.input.value=Math.round(this.placeOf(t)),this.output.textContent=this.words(t)}};var Gg="uplot",Wg="u-hz",Xg="u-vt",qg="u-title",Yg="u-wrap",$g="u-under",Zg="u-over",Jg="u-axis",Os="u-off",Kg="u-select",jg="u-cursor-x",Qg="u-cursor-y",t0="u-cursor-pt",e0="u-legend",n0="u-live",i0="u-inline",s0="u-series",r0="u-marker",Md="u-label",o0="u-value",go="width",_o="height";var bd="bottom",_r="left",Hc="right",rh="#000",Sd=rh+"0",Gc="mousemove",wd="mousedown",Wc="mouseup",Ed="mouseenter",Td="mouseleave",Ad="dblclick",a0="resize",l0="scroll",Rd="change",_a="dppxchange",oh="--",wr=typeof window<"u",Zc=wr?document:null,yr=wr?window:null,c0=wr?navigator:null,ve,fa;function Jc(){let i=devicePixelRatio;ve!=i&&(ve=i,fa&&jc(Rd,fa,Jc),fa=matchMedia(`(min-resolution: ${ve-.001}dppx) and (max-resolution: ${ve+.001}dppx)`),Bs(Rd,fa,Jc),yr.dispatchEvent(new CustomEvent(_a)))}function Yn(i,t){if(t!=null){let e=i.classList;!e.contains(t)&&e.add(t)}}function Kc(i,t){let e=i.classList;e.contains(t)&&e.remove(t)}function He(i,t,e){i.style[t]=e+"px"}function fi(i,t,e,n){let s=Zc.createElement(i);return t!=null&&Yn(s,t),e?.insertBefore(s,n),s}function ni(i,t){return fi("div",i,t)}var Cd=new WeakMap;function Ci(i,t,e,n,s){let r="translate("+t+"px,"+e+"px)",o=Cd.get(i);r!=o&&(i.style.transform=r,Cd.set(i,r),t<0||e<0||t>n||e>s?Yn(i,Os):Kc(i,Os))}var Pd=new WeakMap;function Id(i,t,e){let n=t+e,s=Pd.get(i);n!=s&&(Pd.set(i,n),i.style.background=t,i.style.borderColor=e)}var Ld=new WeakMap;function Dd(i,t,e,n){let s=t+""+e,r=Ld.get(i);s!=r&&(Ld.set(i,s),i.style.height=e+"px",i.style.width=t+"px",i.style.marginLeft=n?-t/2+"px":0,i.style.marginTop=n?-e/2+"px":0)}var ah={passive:!0},h0={...ah,capture:!0};function Bs(i,t,e,n){t.addEventListener(i,e,n?h0:ah)}function jc(i,t,e,n){t.removeEventListener(i,e,ah)}wr&&Jc();function pi(i,t,e,n){let s;e=e||0,n=n||t.length-1;let r=n<=2147483647;for(;n-e>1;)s=r?e+n>>1:$n((e+n)/2),t[s]<i?e=s:n=s;return i-t[e]<=t[n]-i?e:n}function lf(i){return(e,n,s)=>{let r=-1,o=-1;for(let a=n;a<=s;a++)if(i(e[a])){r=a;break}for(let a=s;a>=n;a--)if(i(e[a])){o=a;break}return[r,o]}}var cf=i=>i!=null,hf=i=>i!=null&&i>0,va=lf(cf),u0=lf(hf);function d0(i,t,e,n=0,s=!1){let r=s?u0:va,o=s?hf:cf;[t,e]=r(i,t,e);let a=i[t],c=i[t];if(t>-1)if(n==1)a=i[t],c=i[e];else if(n==-1)a=i[e],c=i[t];else for(let l=t;l<=e;l++){let h=i[l];o(h)&&(h<a?a=h:h>c&&(c=h))}return[a??Ie,c??-Ie]}function Ma(i,t,e,n){let s=Fd(i),r=Fd(t);i==t&&(s==-1?(i*=e,t/=e):(i/=e,t*=e));let o=e==10?ki:uf,a=s==1?$n:ii,c=r==1?ii:$n,l=a(o(rn(i))),h=c(o(rn(t))),u=vr(e,l),d=vr(e,h);return e==10&&(l<0&&(u=Le(u,-l)),h<0&&(d=Le(d,-h))),n||e==2?(i=u*s,t=d*r):(i=mf(i,u),t=ba(t,d)),[i,t]}function lh(i,t,e,n){let s=Ma(i,t,e,n);return i==0&&(s[0]=0),t==0&&(s[1]=0),s}var ch=.1,Nd={mode:3,pad:ch},yo={pad:0,soft:null,mode:0},f0={min:yo,max:yo};function xa(i,t,e,n){return Sa(e)?Ud(i,t,e):(yo.pad=e,yo.soft=n?0:null,yo.mode=n?3:0,Ud(i,t,f0))}function _e(i,t){return i??t}function p0(i,t,e){for(t=_e(t,0),e=_e(e,i.length-1);t<=e;){if(i[t]!=null)return!0;t++}return!1}function Ud(i,t,e){let n=e.min,s=e.max,r=_e(n.pad,0),o=_e(s.pad,0),a=_e(n.hard,-Ie),c=_e(s.hard,Ie),l=_e(n.soft,Ie),h=_e(s.soft,-Ie),u=_e(n.mode,0),d=_e(s.mode,0),f=t-i,g=ki(f),x=Ln(rn(i),rn(t)),m=ki(x),p=rn(m-g);(f<1e-24||p>10)&&(f=0,(i==0||t==0)&&(f=1e-24,u==2&&l!=Ie&&(r=0),d==2&&h!=-Ie&&(o=0)));let w=f||x||1e3,E=ki(w),v=vr(10,$n(E)),C=w*(f==0?i==0?.1:1:r),A=Le(mf(i-C,v/10),24),D=i>=l&&(u==1||u==3&&A<=l||u==2&&A>=l)?l:Ie,U=Ln(a,A<D&&i>=D?D:mi(D,A)),S=w*(f==0?t==0?.1:1:o),b=Le(ba(t+S,v/10),24),P=t<=h&&(d==1||d==3&&b>=h||d==2&&b<=h)?h:-Ie,O=mi(c,b>P&&t<=P?P:Ln(P,b));return U==O&&U==0&&(O=100),[U,O]}var m0=new Intl.NumberFormat(wr?c0.language:"en-US"),hh=i=>m0.format(i),Zn=Math,ga=Zn.PI,rn=Zn.abs,$n=Zn.floor,sn=Zn.round,ii=Zn.ceil,mi=Zn.min,Ln=Zn.max,vr=Zn.pow,Fd=Zn.sign,ki=Zn.log10,uf=Zn.log2,g0=(i,t=1)=>Zn.sinh(i)*t,Xc=(i,t=1)=>Zn.asinh(i/t),Ie=1/0;function Od(i){return(ki((i^i>>31)-(i>>31))|0)+1}function Qc(i,t,e){return mi(Ln(i,t),e)}function df(i){return typeof i=="function"}function ue(i){return df(i)?i:()=>i}var _0=()=>{},ff=i=>i,pf=(i,t)=>t,x0=i=>null,Bd=i=>!0,kd=(i,t)=>i==t,y0=/\.\d*?(?=9{6,}|0{6,})/gm,ks=i=>{if(_f(i)||ls.has(i))return i;let t=`${i}`,e=t.match(y0);if(e==null)return i;let n=e[0].length-1;if(t.indexOf("e-")!=-1){let[s,r]=t.split("e");return+`${ks(s)}e${r}`}return Le(i,n)};function Us(i,t){return ks(Le(ks(i/t))*t)}function ba(i,t){return ks(ii(ks(i/t))*t)}function mf(i,t){return ks($n(ks(i/t))*t)}function Le(i,t=0){if(_f(i))return i;let e=10**t,n=i*e*(1+Number.EPSILON);return sn(n)/e}var ls=new Map;function gf(i){return((""+i).split(".")[1]||"").length}function Mo(i,t,e,n){let s=[],r=n.map(gf);for(let o=t;o<e;o++){let a=rn(o),c=Le(vr(i,o),a);for(let l=0;l<n.length;l++){let h=i==10?+`${n[l]}e${o}`:n[l]*c,u=(o>=0?0:a)+(o>=r[l]?0:r[l]),d=i==10?h:Le(h,u);s.push(d),ls.set(d,u)}}return s}var vo={},uh=[],Mr=[null,null],as=Array.isArray,_f=Number.isInteger,v0=i=>i===void 0;function zd(i){return typeof i=="string"}function Sa(i){let t=!1;if(i!=null){let e=i.constructor;t=e==null||e==Object}return t}function M0(i){return i!=null&&typeof i=="object"}var b0=Object.getPrototypeOf(Uint8Array),xf="__proto__";function br(i,t=Sa){let e;if(as(i)){let n=i.find(s=>s!=null);if(as(n)||t(n)){e=Array(i.length);for(let s=0;s<i.length;s++)e[s]=br(i[s],t)}else e=i.slice()}else if(i instanceof b0)e=i.slice();else if(t(i)){e={};for(let n in i)n!=xf&&(e[n]=br(i[n],t))}else e=i;return e}function Ke(i){let t=arguments;for(let e=1;e<t.length;e++){let n=t[e];for(let s in n)s!=xf&&(Sa(i[s])?Ke(i[s],br(n[s])):i[s]=br(n[s]))}return i}var S0=0,w0=1,E0=2;function T0(i,t,e){for(let n=0,s,r=-1;n<t.length;n++){let o=t[n];if(o>r){for(s=o-1;s>=0&&i[s]==null;)i[s--]=null;for(s=o+1;s<e&&i[s]==null;)i[r=s++]=null}}}function A0(i,t){if(P0(i)){let o=i[0].slice();for(let a=1;a<i.length;a++)o.push(...i[a].slice(1));return I0(o[0])||(o=C0(o)),o}let e=new Set;for(let o=0;o<i.length;o++){let c=i[o][0],l=c.length;for(let h=0;h<l;h++)e.add(c[h])}let n=[Array.from(e).sort((o,a)=>o-a)],s=n[0].length,r=new Map;for(let o=0;o<s;o++)r.set(n[0][o],o);for(let o=0;o<i.length;o++){let a=i[o],c=a[0];for(let l=1;l<a.length;l++){let h=a[l],u=Array(s).fill(void 0),d=t?t[o][l]:w0,f=[];for(let g=0;g<h.length;g++){let x=h[g],m=r.get(c[g]);x===null?d!=S0&&(u[m]=x,d==E0&&f.push(m)):u[m]=x}T0(u,f,s),n.push(u)}}return n}var R0=typeof queueMicrotask>"u"?i=>Promise.resolve().then(i):queueMicrotask;function C0(i){let t=i[0],e=t.length,n=Array(e);for(let r=0;r<n.length;r++)n[r]=r;n.sort((r,o)=>t[r]-t[o]);let s=[];for(let r=0;r<i.length;r++){let o=i[r],a=Array(e);for(let c=0;c<e;c++)a[c]=o[n[c]];s.push(a)}return s}function P0(i){let t=i[0][0],e=t.length;for(let n=1;n<i.length;n++){let s=i[n][0];if(s.length!=e)return!1;if(s!=t){for(let r=0;r<e;r++)if(s[r]!=t[r])return!1}}return!0}function I0(i,t=100){let e=i.length;if(e<=1)return!0;let n=0,s=e-1;for(;n<=s&&i[n]==null;)n++;for(;s>=n&&i[s]==null;)s--;if(s<=n)return!0;let r=Ln(1,$n((s-n+1)/t));for(let o=i[n],a=n+r;a<=s;a+=r){let c=i[a];if(c!=null){if(c<=o)return!1;o=c}}return!0}var yf=["January","February","March","April","May","June","July","August","September","October","November","December"],vf=["Sunday","Monday","Tuesday","Wednesday","Thursday","Friday","Saturday"];function Mf(i){return i.slice(0,3)}var L0=vf.map(Mf),D0=yf.map(Mf),N0={MMMM:yf,MMM:D0,WWWW:vf,WWW:L0};function mo(i){return(i<10?"0":"")+i}function U0(i){return(i<10?"00":i<100?"0":"")+i}var F0={YYYY:i=>i.getFullYear(),YY:i=>(i.getFullYear()+"").slice(2),MMMM:(i,t)=>t.MMMM[i.getMonth()],MMM:(i,t)=>t.MMM[i.getMonth()],MM:i=>mo(i.getMonth()+1),M:i=>i.getMonth()+1,DD:i=>mo(i.getDate()),D:i=>i.getDate(),WWWW:(i,t)=>t.WWWW[i.getDay()],WWW:(i,t)=>t.WWW[i.getDay()],HH:i=>mo(i.getHours()),H:i=>i.getHours(),h:i=>{let t=i.getHours();return t==0?12:t>12?t-12:t},AA:i=>i.getHours()>=12?"PM":"AM",aa:i=>i.getHours()>=12?"pm":"am",a:i=>i.getHours()>=12?"p":"a",mm:i=>mo(i.getMinutes()),m:i=>i.getMinutes(),ss:i=>mo(i.getSeconds()),s:i=>i.getSeconds(),fff:i=>U0(i.getMilliseconds())};function dh(i,t){t=t||N0;let e=[],n=/\{([a-z]+)\}|[^{]+/gi,s;for(;s=n.exec(i);)e.push(s[0][0]=="{"?F0[s[1]]:s[0]);return r=>{let o="";for(let a=0;a<e.length;a++)o+=typeof e[a]=="string"?e[a]:e[a](r,t);return o}}var O0=new Intl.DateTimeFormat().resolvedOptions().timeZone;function B0(i,t){let e;return t=="UTC"||t=="Etc/UTC"?e=new Date(+i+i.getTimezoneOffset()*6e4):t==O0?e=i:(e=new Date(i.toLocaleString("en-US",{timeZone:t})),e.setMilliseconds(i.getMilliseconds())),e}var bf=i=>i%1==0,ya=[1,2,2.5,5],k0=Mo(10,-32,0,ya),Sf=Mo(10,0,32,ya),z0=Sf.filter(bf),Fs=k0.concat(Sf),fh=`
`,wf="{YYYY}",Vd=fh+wf,Ef="{M}/{D}",xo=fh+Ef,pa=xo+"/{YY}",Tf="{aa}",V0="{h}:{mm}",xr=V0+Tf,Hd=fh+xr,Gd=":{ss}",Me=null;function Af(i){let t=i*1e3,e=t*60,n=e*60,s=n*24,r=s*30,o=s*365,c=(i==1?Mo(10,0,3,ya).filter(bf):Mo(10,-3,0,ya)).concat([t,t*5,t*10,t*15,t*30,e,e*5,e*10,e*15,e*30,n,n*2,n*3,n*4,n*6,n*8,n*12,s,s*2,s*3,s*4,s*5,s*6,s*7,s*8,s*9,s*10,s*15,r,r*2,r*3,r*4,r*6,o,o*2,o*5,o*10,o*25,o*50,o*100]),l=[[o,wf,Me,Me,Me,Me,Me,Me,1],[s*28,"{MMM}",Vd,Me,Me,Me,Me,Me,1],[s,Ef,Vd,Me,Me,Me,Me,Me,1],[n,"{h}"+Tf,pa,Me,xo,Me,Me,Me,1],[e,xr,pa,Me,xo,Me,Me,Me,1],[t,Gd,pa+" "+xr,Me,xo+" "+xr,Me,Hd,Me,1],[i,Gd+".{fff}",pa+" "+xr,Me,xo+" "+xr,Me,Hd,Me,1]];function h(u){return(d,f,g,x,m,p)=>{let w=[],E=m>=o,v=m>=r&&m<o,C=u(g),A=Le(C*i,3),D=qc(C.getFullYear(),E?0:C.getMonth(),v||E?1:C.getDate()),U=Le(D*i,3);if(v||E){let S=v?m/r:0,b=E?m/o:0,P=A==U?A:Le(qc(D.getFullYear()+b,D.getMonth()+S,1)*i,3),O=new Date(sn(P/i)),z=O.getFullYear(),W=O.getMonth();for(let X=0;P<=x;X++){let Y=qc(z+b*X,W+S*X,1),j=Y-u(Le(Y*i,3));P=Le((+Y+j)*i,3),P<=x&&w.push(P)}}else{let S=m>=s?s:m,b=$n(g)-$n(A),P=U+b+ba(A-U,S);w.push(P);let O=u(P),z=O.getHours()+O.getMinutes()/e+O.getSeconds()/n,W=m/n,X=d.axes[f]._space,Y=p/X;for(;P=Le(P+m,i==1?0:3),!(P>x);)if(W>1){let j=$n(Le(z+W,6))%24,lt=u(P).getHours()-j;lt>1&&(lt=-1),P-=lt*n,z=(z+W)%24;let xt=w[w.length-1];Le((P-xt)/m,3)*Y>=.7&&w.push(P)}else w.push(P)}return w}}return[c,l,h]}var[H0,G0,W0]=Af(1),[X0,q0,Y0]=Af(.001);Mo(2,-53,53,[1]);function Wd(i,t){return i.map(e=>e.map((n,s)=>s==0||s==8||n==null?n:t(s==1||e[8]==0?n:e[1]+n)))}function Xd(i,t){return(e,n,s,r,o)=>{let a=t.find(g=>o>=g[0])||t[t.length-1],c,l,h,u,d,f;return n.map(g=>{let x=i(g),m=x.getFullYear(),p=x.getMonth(),w=x.getDate(),E=x.getHours(),v=x.getMinutes(),C=x.getSeconds(),A=m!=c&&a[2]||p!=l&&a[3]||w!=h&&a[4]||E!=u&&a[5]||v!=d&&a[6]||C!=f&&a[7]||a[1];return c=m,l=p,h=w,u=E,d=v,f=C,A(x)})}}function $0(i,t){let e=dh(t);return(n,s,r,o,a)=>s.map(c=>e(i(c)))}function qc(i,t,e){return new Date(i,t,e)}function qd(i,t){return t(i)}var Z0="{YYYY}-{MM}-{DD} {h}:{mm}{aa}";function Yd(i,t){return(e,n,s,r)=>r==null?oh:t(i(n))}function J0(i,t){let e=i.series[t];return e.width?e.stroke(i,t):e.points.width?e.points.stroke(i,t):null}function K0(i,t){return i.series[t].fill(i,t)}var j0={show:!0,live:!0,isolate:!1,mount:_0,markers:{show:!0,width:2,stroke:J0,fill:K0,dash:"solid"},idx:null,idxs:null,values:[]};function Q0(i,t){let e=i.cursor.points,n=ni(),s=e.size(i,t);He(n,go,s),He(n,_o,s);let r=s/-2;He(n,"marginLeft",r),He(n,"marginTop",r);let o=e.width(i,t,s);return o&&He(n,"borderWidth",o),n}function t_(i,t){let e=i.series[t].points;return e._fill||e._stroke}function e_(i,t){let e=i.series[t].points;return e._stroke||e._fill}function n_(i,t){return i.series[t].points.size}var Yc=[0,0];function i_(i,t,e){return Yc[0]=t,Yc[1]=e,Yc}function ma(i,t,e,n=!0){return s=>{s.button==0&&(!n||s.target==t)&&e(s)}}function $c(i,t,e,n=!0){return s=>{(!n||s.target==t)&&e(s)}}var s_={show:!0,x:!0,y:!0,lock:!1,move:i_,points:{one:!1,show:Q0,size:n_,width:0,stroke:e_,fill:t_},bind:{mousedown:ma,mouseup:ma,click:ma,dblclick:ma,mousemove:$c,mouseleave:$c,mouseenter:$c},drag:{setScale:!0,x:!0,y:!1,dist:0,uni:null,click:(i,t)=>{t.stopPropagation(),t.stopImmediatePropagation()},_x:!1,_y:!1},focus:{dist:(i,t,e,n,s)=>n-s,prox:-1,bias:0},hover:{skip:[void 0],prox:null,bias:0},left:-10,top:-10,idx:null,dataIdx:null,idxs:null,event:null},Rf={show:!0,stroke:"rgba(0,0,0,0.07)",width:2},ph=Ke({},Rf,{filter:pf}),Cf=Ke({},ph,{size:10}),Pf=Ke({},Rf,{show:!1}),mh='12px system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, "Noto Sans", sans-serif, "Apple Color Emoji", "Segoe UI Emoji", "Segoe UI Symbol", "Noto Color Emoji"',If="bold "+mh,Lf=1.5,$d={show:!0,scale:"x",stroke:rh,space:50,gap:5,alignTo:1,size:50,labelGap:0,labelSize:30,labelFont:If,side:2,grid:ph,ticks:Cf,border:Pf,font:mh,lineGap:Lf,rotate:0},r_="Value",o_="Time",Zd={show:!0,scale:"x",auto:!1,sorted:1,min:Ie,max:-Ie,idxs:[]};function a_(i,t,e,n,s){return t.map(r=>r==null?"":hh(r))}function l_(i,t,e,n,s,r,o){let a=[],c=ls.get(s)||0;e=o?e:Le(ba(e,s),c);for(let l=e;l<=n;l=Le(l+s,c))a.push(Object.is(l,-0)?0:l);return a}function th(i,t,e,n,s,r,o){let a=[],c=i.scales[i.axes[t].scale].log,l=c==10?ki:uf,h=$n(l(e));s=vr(c,h),c==10&&(s=Fs[pi(s,Fs)]);let u=e,d=s*c;c==10&&(d=Fs[pi(d,Fs)]);do a.push(u),u=u+s,c==10&&!ls.has(u)&&(u=Le(u,ls.get(s))),u>=d&&(s=u,d=s*c,c==10&&(d=Fs[pi(d,Fs)]));while(u<=n);return a}function c_(i,t,e,n,s,r,o){let c=i.scales[i.axes[t].scale].asinh,l=n>c?th(i,t,Ln(c,e),n,s):[c],h=n>=0&&e<=0?[0]:[];return(e<-c?th(i,t,Ln(c,-n),-e,s):[c]).reverse().map(d=>-d).concat(h,l)}var Df=/./,h_=/[12357]/,u_=/[125]/,Jd=/1/,eh=(i,t,e,n)=>i.map((s,r)=>t==4&&s==0||r%n==0&&e.test(s.toExponential()[s<0?1:0])?s:null);function d_(i,t,e,n,s){let r=i.axes[e],o=r.scale,a=i.scales[o],c=i.valToPos,l=r._space,h=c(10,o),u=c(9,o)-h>=l?Df:c(7,o)-h>=l?h_:c(5,o)-h>=l?u_:Jd;if(u==Jd){let d=rn(c(1,o)-h);if(d<l)return eh(t.slice().reverse(),a.distr,u,ii(l/d)).reverse()}return eh(t,a.distr,u,1)}function f_(i,t,e,n,s){let r=i.axes[e],o=r.scale,a=r._space,c=i.valToPos,l=rn(c(1,o)-c(2,o));return l<a?eh(t.slice().reverse(),3,Df,ii(a/l)).reverse():t}function p_(i,t,e,n){return n==null?oh:t==null?"":hh(t)}var Kd={show:!0,scale:"y",stroke:rh,space:30,gap:5,alignTo:1,size:50,labelGap:0,labelSize:30,labelFont:If,side:3,grid:ph,ticks:Cf,border:Pf,font:mh,lineGap:Lf,rotate:0};function m_(i,t){let e=3+(i||1)*2;return Le(e*t,3)}function g_(i,t){let{scale:e,idxs:n}=i.series[0],s=i._data[0],r=i.valToPos(s[n[0]],e,!0),o=i.valToPos(s[n[1]],e,!0),a=rn(o-r),c=i.series[t],l=a/(c.points.space*ve);return n[1]-n[0]<=l}var jd={scale:null,auto:!0,sorted:0,min:Ie,max:-Ie},Nf=(i,t,e,n,s)=>s,Qd={show:!0,auto:!0,sorted:0,gaps:Nf,alpha:1,facets:[Ke({},jd,{scale:"x"}),Ke({},jd,{scale:"y"})]},tf={scale:"y",auto:!0,sorted:0,show:!0,spanGaps:!1,gaps:Nf,alpha:1,points:{show:g_,filter:null},values:null,min:Ie,max:-Ie,idxs:[],path:null,clip:null};function __(i,t,e,n,s){return e/10}var Uf={time:!0,auto:!0,distr:1,log:10,asinh:1,min:null,max:null,dir:1,ori:0},x_=Ke({},Uf,{time:!1,ori:1}),ef={};function Ff(i,t){let e=ef[i];return e||(e={key:i,plots:[],sub(n){e.plots.push(n)},unsub(n){e.plots=e.plots.filter(s=>s!=n)},pub(n,s,r,o,a,c,l){for(let h=0;h<e.plots.length;h++)e.plots[h]!=s&&e.plots[h].pub(n,s,r,o,a,c,l)}},i!=null&&(ef[i]=e)),e}var Sr=1,nh=2;function zs(i,t,e){let n=i.mode,s=i.series[t],r=n==2?i._data[t]:i._data,o=i.scales,a=i.bbox,c=r[0],l=n==2?r[1]:r[t],h=n==2?o[s.facets[0].scale]:o[i.series[0].scale],u=n==2?o[s.facets[1].scale]:o[s.scale],d=a.left,f=a.top,g=a.width,x=a.height,m=i.valToPosH,p=i.valToPosV;return h.ori==0?e(s,c,l,h,u,m,p,d,f,g,x,Ea,Er,Aa,Bf,zf):e(s,c,l,h,u,p,m,f,d,x,g,Ta,Tr,xh,kf,Vf)}function gh(i,t){let e=0,n=0,s=_e(i.bands,uh);for(let r=0;r<s.length;r++){let o=s[r];o.series[0]==t?e=o.dir:o.series[1]==t&&(o.dir==1?n|=1:n|=2)}return[e,n==1?-1:n==2?1:n==3?2:0]}function y_(i,t,e,n,s){let r=i.mode,o=i.series[t],a=r==2?o.facets[1].scale:o.scale,c=i.scales[a];return s==-1?c.min:s==1?c.max:c.distr==3?c.dir==1?c.min:c.max:0}function zi(i,t,e,n,s,r){return zs(i,t,(o,a,c,l,h,u,d,f,g,x,m)=>{let p=o.pxRound,w=l.dir*(l.ori==0?1:-1),E=l.ori==0?Er:Tr,v,C;w==1?(v=e,C=n):(v=n,C=e);let A=p(u(a[v],l,x,f)),D=p(d(c[v],h,m,g)),U=p(u(a[C],l,x,f)),S=p(d(r==1?h.max:h.min,h,m,g)),b=new Path2D(s);return E(b,U,S),E(b,A,S),E(b,A,D),b})}function wa(i,t,e,n,s,r){let o=null;if(i.length>0){o=new Path2D;let a=t==0?Aa:xh,c=e;for(let u=0;u<i.length;u++){let d=i[u];if(d[1]>d[0]){let f=d[0]-c;f>0&&a(o,c,n,f,n+r),c=d[1]}}let l=e+s-c,h=10;l>0&&a(o,c,n-h/2,l,n+r+h)}return o}function v_(i,t,e){let n=i[i.length-1];n&&n[0]==t?n[1]=e:i.push([t,e])}function _h(i,t,e,n,s,r,o){let a=[],c=i.length;for(let l=s==1?e:n;l>=e&&l<=n;l+=s)if(t[l]===null){let u=l,d=l;if(s==1)for(;++l<=n&&t[l]===null;)d=l;else for(;--l>=e&&t[l]===null;)d=l;let f=r(i[u]),g=d==u?f:r(i[d]),x=u-s;f=o<=0&&x>=0&&x<c?r(i[x]):f;let p=d+s;g=o>=0&&p>=0&&p<c?r(i[p]):g,g>=f&&a.push([f,g])}return a}function nf(i){return i==0?ff:i==1?sn:t=>Us(t,i)}function Of(i){let t=i==0?Ea:Ta,e=i==0?(s,r,o,a,c,l)=>{s.arcTo(r,o,a,c,l)}:(s,r,o,a,c,l)=>{s.arcTo(o,r,c,a,l)},n=i==0?(s,r,o,a,c)=>{s.rect(r,o,a,c)}:(s,r,o,a,c)=>{s.rect(o,r,c,a)};return(s,r,o,a,c,l=0,h=0)=>{l==0&&h==0?n(s,r,o,a,c):(l=mi(l,a/2,c/2),h=mi(h,a/2,c/2),t(s,r+l,o),e(s,r+a,o,r+a,o+c,l),e(s,r+a,o+c,r,o+c,h),e(s,r,o+c,r,o,h),e(s,r,o,r+a,o,l),s.closePath())}}var Ea=(i,t,e)=>{i.moveTo(t,e)},Ta=(i,t,e)=>{i.moveTo(e,t)},Er=(i,t,e)=>{i.lineTo(t,e)},Tr=(i,t,e)=>{i.lineTo(e,t)},Aa=Of(0),xh=Of(1),Bf=(i,t,e,n,s,r)=>{i.arc(t,e,n,s,r)},kf=(i,t,e,n,s,r)=>{i.arc(e,t,n,s,r)},zf=(i,t,e,n,s,r,o)=>{i.bezierCurveTo(t,e,n,s,r,o)},Vf=(i,t,e,n,s,r,o)=>{i.bezierCurveTo(e,t,s,n,o,r)};function Hf(i){return(t,e,n,s,r)=>zs(t,e,(o,a,c,l,h,u,d,f,g,x,m)=>{let{pxRound:p,points:w}=o,E,v;l.ori==0?(E=Ea,v=Bf):(E=Ta,v=kf);let C=Le(w.width*ve,3),A=(w.size-w.width)/2*ve,D=Le(A*2,3),U=new Path2D,S=new Path2D,{left:b,top:P,width:O,height:z}=t.bbox;Aa(S,b-D,P-D,O+D*2,z+D*2);let W=X=>{if(c[X]!=null){let Y=p(u(a[X],l,x,f)),j=p(d(c[X],h,m,g));E(U,Y+A,j),v(U,Y,j,A,0,ga*2)}};if(r)r.forEach(W);else for(let X=n;X<=s;X++)W(X);return{stroke:C>0?U:null,fill:U,clip:S,flags:Sr|nh}})}function Gf(i){return(t,e,n,s,r,o)=>{n!=s&&(r!=n&&o!=n&&i(t,e,n),r!=s&&o!=s&&i(t,e,s),i(t,e,o))}}var M_=Gf(Er),b_=Gf(Tr);function Wf(i){let t=_e(i?.alignGaps,0);return(e,n,s,r)=>zs(e,n,(o,a,c,l,h,u,d,f,g,x,m)=>{[s,r]=va(c,s,r);let p=o.pxRound,w=z=>p(u(z,l,x,f)),E=z=>p(d(z,h,m,g)),v,C;l.ori==0?(v=Er,C=M_):(v=Tr,C=b_);let A=l.dir*(l.ori==0?1:-1),D={stroke:new Path2D,fill:null,clip:null,band:null,gaps:null,flags:Sr},U=D.stroke,S=!1;if(r-s>=x*4){let z=_t=>e.posToVal(_t,l.key,!0),W=null,X=null,Y,j,K,at=w(a[A==1?s:r]),lt=w(a[s]),xt=w(a[r]),Mt=z(A==1?lt+1:xt-1);for(let _t=A==1?s:r;_t>=s&&_t<=r;_t+=A){let ie=a[_t],Q=(A==1?ie<Mt:ie>Mt)?at:w(ie),et=c[_t];Q==at?et!=null?(j=et,W==null?(v(U,Q,E(j)),Y=W=X=j):j<W?W=j:j>X&&(X=j)):et===null&&(S=!0):(W!=null&&C(U,at,E(W),E(X),E(Y),E(j)),et!=null?(j=et,v(U,Q,E(j)),W=X=Y=j):(W=X=null,et===null&&(S=!0)),at=Q,Mt=z(at+A))}W!=null&&W!=X&&K!=at&&C(U,at,E(W),E(X),E(Y),E(j))}else for(let z=A==1?s:r;z>=s&&z<=r;z+=A){let W=c[z];W===null?S=!0:W!=null&&v(U,w(a[z]),E(W))}let[P,O]=gh(e,n);if(o.fill!=null||P!=0){let z=D.fill=new Path2D(U),W=o.fillTo(e,n,o.min,o.max,P),X=E(W),Y=w(a[s]),j=w(a[r]);A==-1&&([j,Y]=[Y,j]),v(z,j,X),v(z,Y,X)}if(!o.spanGaps){let z=[];S&&z.push(..._h(a,c,s,r,A,w,t)),D.gaps=z=o.gaps(e,n,s,r,z),D.clip=wa(z,l.ori,f,g,x,m)}return O!=0&&(D.band=O==2?[zi(e,n,s,r,U,-1),zi(e,n,s,r,U,1)]:zi(e,n,s,r,U,O)),D})}function S_(i){let t=_e(i.align,1),e=_e(i.ascDesc,!1),n=_e(i.alignGaps,0),s=_e(i.extend,!1);return(r,o,a,c)=>zs(r,o,(l,h,u,d,f,g,x,m,p,w,E)=>{[a,c]=va(u,a,c);let v=l.pxRound,{left:C,width:A}=r.bbox,D=lt=>v(g(lt,d,w,m)),U=lt=>v(x(lt,f,E,p)),S=d.ori==0?Er:Tr,b={stroke:new Path2D,fill:null,clip:null,band:null,gaps:null,flags:Sr},P=b.stroke,O=d.dir*(d.ori==0?1:-1),z=U(u[O==1?a:c]),W=D(h[O==1?a:c]),X=W,Y=W;s&&t==-1&&(Y=C,S(P,Y,z)),S(P,W,z);for(let lt=O==1?a:c;lt>=a&&lt<=c;lt+=O){let xt=u[lt];if(xt==null)continue;let Mt=D(h[lt]),_t=U(xt);t==1?S(P,Mt,z):S(P,X,_t),S(P,Mt,_t),z=_t,X=Mt}let j=X;s&&t==1&&(j=C+A,S(P,j,z));let[K,at]=gh(r,o);if(l.fill!=null||K!=0){let lt=b.fill=new Path2D(P),xt=l.fillTo(r,o,l.min,l.max,K),Mt=U(xt);S(lt,j,Mt),S(lt,Y,Mt)}if(!l.spanGaps){let lt=[];lt.push(..._h(h,u,a,c,O,D,n));let xt=l.width*ve/2,Mt=e||t==1?xt:-xt,_t=e||t==-1?-xt:xt;lt.forEach(ie=>{ie[0]+=Mt,ie[1]+=_t}),b.gaps=lt=l.gaps(r,o,a,c,lt),b.clip=wa(lt,d.ori,m,p,w,E)}return at!=0&&(b.band=at==2?[zi(r,o,a,c,P,-1),zi(r,o,a,c,P,1)]:zi(r,o,a,c,P,at)),b})}function sf(i,t,e,n,s,r,o=Ie){if(i.length>1){let a=null;for(let c=0,l=1/0;c<i.length;c++)if(t[c]!==void 0){if(a!=null){let h=rn(i[c]-i[a]);h<l&&(l=h,o=rn(e(i[c],n,s,r)-e(i[a],n,s,r)))}a=c}}return o}function w_(i){i=i||vo;let t=_e(i.size,[.6,Ie,1]),e=i.align||0,n=i.gap||0,s=i.radius;s=s==null?[0,0]:typeof s=="number"?[s,0]:s;let r=ue(s),o=1-t[0],a=_e(t[1],Ie),c=_e(t[2],1),l=_e(i.disp,vo),h=_e(i.each,f=>{}),{fill:u,stroke:d}=l;return(f,g,x,m)=>zs(f,g,(p,w,E,v,C,A,D,U,S,b,P)=>{let O=p.pxRound,z=e,W=n*ve,X=a*ve,Y=c*ve,j,K;v.ori==0?[j,K]=r(f,g):[K,j]=r(f,g);let at=v.dir*(v.ori==0?1:-1),lt=v.ori==0?Aa:xh,xt=v.ori==0?h:(F,Z,nt,tt,Ut,ut,It)=>{h(F,Z,nt,Ut,tt,It,ut)},Mt=_e(f.bands,uh).find(F=>F.series[0]==g),_t=Mt!=null?Mt.dir:0,ie=p.fillTo(f,g,p.min,p.max,_t),Qt=O(D(ie,C,P,S)),Q,et,wt,kt=b,yt=O(p.width*ve),te=!1,De=null,N=null,de=null,$t=null;u!=null&&(yt==0||d!=null)&&(te=!0,De=u.values(f,g,x,m),N=new Map,new Set(De).forEach(F=>{F!=null&&N.set(F,new Path2D)}),yt>0&&(de=d.values(f,g,x,m),$t=new Map,new Set(de).forEach(F=>{F!=null&&$t.set(F,new Path2D)})));let{x0:Gt,size:Nt}=l;if(Gt!=null&&Nt!=null){z=1,w=Gt.values(f,g,x,m),Gt.unit==2&&(w=w.map(nt=>f.posToVal(U+nt*b,v.key,!0)));let F=Nt.values(f,g,x,m);Nt.unit==2?et=F[0]*b:et=A(F[0],v,b,U)-A(0,v,b,U),kt=sf(w,E,A,v,b,U,kt),wt=kt-et+W}else kt=sf(w,E,A,v,b,U,kt),wt=kt*o+W,et=kt-wt;wt<1&&(wt=0),yt>=et/2&&(yt=0),wt<5&&(O=ff);let be=wt>0,Ct=kt-wt-(be?yt:0);et=O(Qc(Ct,Y,X)),Q=(z==0?et/2:z==at?0:et)-z*at*((z==0?W/2:0)+(be?yt/2:0));let Ht={stroke:null,fill:null,clip:null,band:null,gaps:null,flags:0},Be=te?null:new Path2D,xe=null;if(Mt!=null)xe=f.data[Mt.series[1]];else{let{y0:F,y1:Z}=l;F!=null&&Z!=null&&(E=Z.values(f,g,x,m),xe=F.values(f,g,x,m))}let I=j*et,y=K*et;for(let F=at==1?x:m;F>=x&&F<=m;F+=at){let Z=E[F];if(Z==null)continue;if(xe!=null){let gt=xe[F]??0;if(Z-gt==0)continue;Qt=D(gt,C,P,S)}let nt=v.distr!=2||l!=null?w[F]:F,tt=A(nt,v,b,U),Ut=D(_e(Z,ie),C,P,S),ut=O(tt-Q),It=O(Ln(Ut,Qt)),At=O(mi(Ut,Qt)),ot=It-At;if(Z!=null){let gt=Z<0?y:I,Bt=Z<0?I:y;te?(yt>0&&de[F]!=null&&lt($t.get(de[F]),ut,At+$n(yt/2),et,Ln(0,ot-yt),gt,Bt),De[F]!=null&&lt(N.get(De[F]),ut,At+$n(yt/2),et,Ln(0,ot-yt),gt,Bt)):lt(Be,ut,At+$n(yt/2),et,Ln(0,ot-yt),gt,Bt),xt(f,g,F,ut-yt/2,At,et+yt,ot)}}return yt>0?Ht.stroke=te?$t:Be:te||(Ht._fill=p.width==0?p._fill:p._stroke??p._fill,Ht.width=0),Ht.fill=te?N:Be,Ht})}function E_(i,t){let e=_e(t?.alignGaps,0);return(n,s,r,o)=>zs(n,s,(a,c,l,h,u,d,f,g,x,m,p)=>{[r,o]=va(l,r,o);let w=a.pxRound,E=j=>w(d(j,h,m,g)),v=j=>w(f(j,u,p,x)),C,A,D;h.ori==0?(C=Ea,D=Er,A=zf):(C=Ta,D=Tr,A=Vf);let U=h.dir*(h.ori==0?1:-1),S=E(c[U==1?r:o]),b=S,P=[],O=[];for(let j=U==1?r:o;j>=r&&j<=o;j+=U)if(l[j]!=null){let at=c[j],lt=E(at);P.push(b=lt),O.push(v(l[j]))}let z={stroke:i(P,O,C,D,A,w),fill:null,clip:null,band:null,gaps:null,flags:Sr},W=z.stroke,[X,Y]=gh(n,s);if(a.fill!=null||X!=0){let j=z.fill=new Path2D(W),K=a.fillTo(n,s,a.min,a.max,X),at=v(K);D(j,b,at),D(j,S,at)}if(!a.spanGaps){let j=[];j.push(..._h(c,l,r,o,U,E,e)),z.gaps=j=a.gaps(n,s,r,o,j),z.clip=wa(j,h.ori,g,x,m,p)}return Y!=0&&(z.band=Y==2?[zi(n,s,r,o,W,-1),zi(n,s,r,o,W,1)]:zi(n,s,r,o,W,Y)),z})}function T_(i){return E_(A_,i)}function A_(i,t,e,n,s,r){let o=i.length;if(o<2)return null;let a=new Path2D;if(e(a,i[0],t[0]),o==2)n(a,i[1],t[1]);else{let c=Array(o),l=Array(o-1),h=Array(o-1),u=Array(o-1);for(let d=0;d<o-1;d++)h[d]=t[d+1]-t[d],u[d]=i[d+1]-i[d],l[d]=h[d]/u[d];c[0]=l[0];for(let d=1;d<o-1;d++)l[d]===0||l[d-1]===0||l[d-1]>0!=l[d]>0?c[d]=0:(c[d]=3*(u[d-1]+u[d])/((2*u[d]+u[d-1])/l[d-1]+(u[d]+2*u[d-1])/l[d]),isFinite(c[d])||(c[d]=0));c[o-1]=l[o-2];for(let d=0;d<o-1;d++)s(a,i[d]+u[d]/3,t[d]+c[d]*u[d]/3,i[d+1]-u[d]/3,t[d+1]-c[d+1]*u[d]/3,i[d+1],t[d+1])}return a}var ih=new Set;function rf(){for(let i of ih)i.syncRect(!0)}wr&&(Bs(a0,yr,rf),Bs(l0,yr,rf,!0),Bs(_a,yr,()=>{vn.pxRatio=ve}));var R_=Wf(),C_=Hf();function of(i,t,e,n){return(n?[i[0],i[1]].concat(i.slice(2)):[i[0]].concat(i.slice(1))).map((r,o)=>sh(r,o,t,e))}function P_(i,t){return i.map((e,n)=>n==0?{}:Ke({},t,e))}function sh(i,t,e,n){return Ke({},t==0?e:n,i)}function Xf(i,t,e){return t==null?Mr:[t,e]}var I_=Xf;function L_(i,t,e){return t==null?Mr:xa(t,e,ch,!0)}function qf(i,t,e,n){return t==null?Mr:Ma(t,e,i.scales[n].log,!1)}var D_=qf;function Yf(i,t,e,n){return t==null?Mr:lh(t,e,i.scales[n].log,!1)}var N_=Yf;function U_(i,t,e,n,s){let r=Ln(Od(i),Od(t)),o=t-i,a=pi(s/n*o,e);do{let c=e[a],l=n*c/o;if(l>=s&&r+(c<5?ls.get(c):0)<=17)return[c,l]}while(++a<e.length);return[0,0]}function af(i){let t,e;return i=i.replace(/(\d+)px/,(n,s)=>(t=sn((e=+s)*ve))+"px"),[i,t,e]}function F_(i){i.show&&[i.font,i.labelFont].forEach(t=>{let e=Le(t[2]*ve,1);t[0]=t[0].replace(/[0-9.]+px/,e+"px"),t[1]=e})}function vn(i,t,e){let n={mode:_e(i.mode,1)},s=n.mode;function r(_,M,R,L){let k=M.valToPct(_);return L+R*(M.dir==-1?1-k:k)}function o(_,M,R,L){let k=M.valToPct(_);return L+R*(M.dir==-1?k:1-k)}function a(_,M,R,L){return M.ori==0?r(_,M,R,L):o(_,M,R,L)}n.valToPosH=r,n.valToPosV=o;let c=!1;n.status=0;let l=n.root=ni(Gg);if(i.id!=null&&(l.id=i.id),Yn(l,i.class),i.title){let _=ni(qg,l);_.textContent=i.title}let h=fi("canvas"),u=n.ctx=h.getContext("2d"),d=ni(Yg,l);Bs("click",d,_=>{_.target===g&&(ke!=ur||Xe!=dr)&&yn.click(n,_)},!0);let f=n.under=ni($g,d);d.appendChild(h);let g=n.over=ni(Zg,d);i=br(i);let x=+_e(i.pxAlign,1),m=nf(x);(i.plugins||[]).forEach(_=>{_.opts&&(i=_.opts(n,i)||i)});let p=i.ms||.001,w=n.series=s==1?of(i.series||[],Zd,tf,!1):P_(i.series||[null],Qd),E=n.axes=of(i.axes||[],$d,Kd,!0),v=n.scales={},C=n.bands=i.bands||[];C.forEach(_=>{_.fill=ue(_.fill||null),_.dir=_e(_.dir,-1)});let A=s==2?w[1].facets[0].scale:w[0].scale,D={axes:rg,series:Ps},U=(i.drawOrder||["axes","series"]).map(_=>D[_]);function S(_){let M=_.distr==3?R=>ki(R>0?R:_.clamp(n,R,_.min,_.max,_.key)):_.distr==4?R=>Xc(R,_.asinh):_.distr==100?R=>_.fwd(R):R=>R;return R=>{let L=M(R),{_min:k,_max:q}=_,it=q-k;return(L-k)/it}}function b(_){let M=v[_];if(M==null){let R=(i.scales||vo)[_]||vo;if(R.from!=null){b(R.from);let L=Ke({},v[R.from],R,{key:_});L.valToPct=S(L),v[_]=L}else{M=v[_]=Ke({},_==A?Uf:x_,R),M.key=_;let L=M.time,k=M.range,q=as(k);if((_!=A||s==2&&!L)&&(q&&(k[0]==null||k[1]==null)&&(k={min:k[0]==null?Nd:{mode:1,hard:k[0],soft:k[0]},max:k[1]==null?Nd:{mode:1,hard:k[1],soft:k[1]}},q=!1),!q&&Sa(k))){let it=k;k=(ct,mt,Tt)=>mt==null?Mr:xa(mt,Tt,it)}M.range=ue(k||(L?I_:_==A?M.distr==3?D_:M.distr==4?N_:Xf:M.distr==3?qf:M.distr==4?Yf:L_)),M.auto=ue(q?!1:M.auto),M.clamp=ue(M.clamp||__),M._min=M._max=null,M.valToPct=S(M)}}}b("x"),b("y"),s==1&&w.forEach(_=>{b(_.scale)}),E.forEach(_=>{b(_.scale)});for(let _ in i.scales)b(_);let P=v[A],O=P.distr,z,W;P.ori==0?(Yn(l,Wg),z=r,W=o):(Yn(l,Xg),z=o,W=r);let X={};for(let _ in v){let M=v[_];(M.min!=null||M.max!=null)&&(X[_]={min:M.min,max:M.max},M.min=M.max=null)}let Y=i.tzDate||(_=>new Date(sn(_/p))),j=i.fmtDate||dh,K=p==1?W0(Y):Y0(Y),at=Xd(Y,Wd(p==1?G0:q0,j)),lt=Yd(Y,qd(Z0,j)),xt=[],Mt=n.legend=Ke({},j0,i.legend),_t=n.cursor=Ke({},s_,{drag:{y:s==2}},i.cursor),ie=Mt.show,Qt=_t.show,Q=Mt.markers;Mt.idxs=xt,Q.width=ue(Q.width),Q.dash=ue(Q.dash),Q.stroke=ue(Q.stroke),Q.fill=ue(Q.fill);let et,wt,kt,yt=[],te=[],De,N=!1,de={};if(Mt.live){let _=w[1]?w[1].values:null;N=_!=null,De=N?_(n,1,0):{_:0};for(let M in De)de[M]=oh}if(ie)if(et=fi("table",e0,l),kt=fi("tbody",null,et),Mt.mount(n,et),N){wt=fi("thead",null,et,kt);let _=fi("tr",null,wt);fi("th",null,_);for(var $t in De)fi("th",Md,_).textContent=$t}else Yn(et,i0),Mt.live&&Yn(et,n0);let Gt={show:!0},Nt={show:!1};function be(_,M){if(M==0&&(N||!Mt.live||s==2))return Mr;let R=[],L=fi("tr",s0,kt,kt.childNodes[M]);Yn(L,_.class),_.show||Yn(L,Os);let k=fi("th",null,L);if(Q.show){let ct=ni(r0,k);if(M>0){let mt=Q.width(n,M);mt&&(ct.style.border=mt+"px "+Q.dash(n,M)+" "+Q.stroke(n,M)),ct.style.background=Q.fill(n,M)}}let q=ni(Md,k);_.label instanceof HTMLElement?q.appendChild(_.label):q.textContent=_.label,M>0&&(Q.show||(q.style.color=_.width>0?Q.stroke(n,M):Q.fill(n,M)),Ht("click",k,ct=>{if(_t._lock)return;xn(ct);let mt=w.indexOf(_);if((ct.ctrlKey||ct.metaKey)!=Mt.isolate){let Tt=w.some((Rt,Dt)=>Dt>0&&Dt!=mt&&Rt.show);w.forEach((Rt,Dt)=>{Dt>0&&Ei(Dt,Tt?Dt==mt?Gt:Nt:Gt,!0,Je.setSeries)})}else Ei(mt,{show:!_.show},!0,Je.setSeries)},!1),On&&Ht(Ed,k,ct=>{_t._lock||(xn(ct),Ei(w.indexOf(_),pr,!0,Je.setSeries))},!1));for(var it in De){let ct=fi("td",o0,L);ct.textContent="--",R.push(ct)}return[L,R]}let Ct=new Map;function Ht(_,M,R,L=!0){let k=Ct.get(M)||{},q=_t.bind[_](n,M,R,L);q&&(Bs(_,M,k[_]=q),Ct.set(M,k))}function Be(_,M,R){let L=Ct.get(M)||{};for(let k in L)(_==null||k==_)&&(jc(k,M,L[k]),delete L[k]);_==null&&Ct.delete(M)}let xe=0,I=0,y=0,F=0,Z=0,nt=0,tt=Z,Ut=nt,ut=y,It=F,At=0,ot=0,gt=0,Bt=0;n.bbox={};let Ot=!1,vt=!1,Kt=!1,B=!1,dt=!1,pt=!1;function Pt(_,M,R){(R||_!=n.width||M!=n.height)&&ht(_,M),ar(!1),Kt=!0,vt=!0,lr()}function ht(_,M){n.width=xe=y=_,n.height=I=F=M,Z=nt=0,Te(),pe();let R=n.bbox;At=R.left=Us(Z*ve,.5),ot=R.top=Us(nt*ve,.5),gt=R.width=Us(y*ve,.5),Bt=R.height=Us(F*ve,.5)}let rt=3;function Ft(){let _=!1,M=0;for(;!_;){M++;let R=ig(M),L=sg(M);_=M==rt||R&&L,_||(ht(n.width,n.height),vt=!0)}}function ee({width:_,height:M}){Pt(_,M)}n.setSize=ee;function Te(){let _=!1,M=!1,R=!1,L=!1;E.forEach((k,q)=>{if(k.show&&k._show){let{side:it,_size:ct}=k,mt=it%2,Tt=k.label!=null?k.labelSize:0,Rt=ct+Tt;Rt>0&&(mt?(y-=Rt,it==3?(Z+=Rt,L=!0):R=!0):(F-=Rt,it==0?(nt+=Rt,_=!0):M=!0))}}),Oi[0]=_,Oi[1]=R,Oi[2]=M,Oi[3]=L,y-=wi[1]+wi[3],Z+=wi[3],F-=wi[2]+wi[0],nt+=wi[0]}function pe(){let _=Z+y,M=nt+F,R=Z,L=nt;function k(q,it){switch(q){case 1:return _+=it,_-it;case 2:return M+=it,M-it;case 3:return R-=it,R+it;case 0:return L-=it,L+it}}E.forEach((q,it)=>{if(q.show&&q._show){let ct=q.side;q._pos=k(ct,q._size),q.label!=null&&(q._lpos=k(ct,q.labelSize))}})}if(_t.dataIdx==null){let _=_t.hover,M=_.skip=new Set(_.skip??[]);M.add(void 0);let R=_.prox=ue(_.prox),L=_.bias??=0;_t.dataIdx=(k,q,it,ct)=>{if(q==0)return it;let mt=it,Tt=R(k,q,it,ct)??Ie,Rt=Tt>=0&&Tt<Ie,Dt=P.ori==0?y:F,ne=_t.left,ye=t[0],ge=t[q];if(M.has(ge[it])){mt=null;let ce=null,Zt=null,Vt;if(L==0||L==-1)for(Vt=it;ce==null&&Vt-- >0;)M.has(ge[Vt])||(ce=Vt);if(L==0||L==1)for(Vt=it;Zt==null&&Vt++<ge.length;)M.has(ge[Vt])||(Zt=Vt);if(ce!=null||Zt!=null)if(Rt){let Ve=ce==null?-1/0:z(ye[ce],P,Dt,0),Ye=Zt==null?1/0:z(ye[Zt],P,Dt,0),mn=ne-Ve,Ae=Ye-ne;mn<=Ae?mn<=Tt&&(mt=ce):Ae<=Tt&&(mt=Zt)}else mt=Zt==null?ce:ce==null?Zt:it-ce<=Zt-it?ce:Zt}else Rt&&rn(ne-z(ye[it],P,Dt,0))>Tt&&(mt=null);return mt}}let xn=_=>{_t.event=_};_t.idxs=xt,_t._lock=!1;let Pe=_t.points;Pe.show=ue(Pe.show),Pe.size=ue(Pe.size),Pe.stroke=ue(Pe.stroke),Pe.width=ue(Pe.width),Pe.fill=ue(Pe.fill);let Gn=n.focus=Ke({},i.focus||{alpha:.3},_t.focus),On=Gn.prox>=0,Si=On&&Pe.one,Tn=[],Fi=[],ci=[];function oo(_,M){let R=Pe.show(n,M);if(R instanceof HTMLElement)return Yn(R,t0),Yn(R,_.class),Ci(R,-10,-10,y,F),g.insertBefore(R,Tn[M]),R}function Rs(_,M){if(s==1||M>0){let R=s==1&&v[_.scale].time,L=_.value;_.value=R?zd(L)?Yd(Y,qd(L,j)):L||lt:L||p_,_.label=_.label||(R?o_:r_)}if(Si||M>0){_.width=_.width==null?1:_.width,_.paths=_.paths||R_||x0,_.fillTo=ue(_.fillTo||y_),_.pxAlign=+_e(_.pxAlign,x),_.pxRound=nf(_.pxAlign),_.stroke=ue(_.stroke||null),_.fill=ue(_.fill||null),_._stroke=_._fill=_._paths=_._focus=null;let R=m_(Ln(1,_.width),1),L=_.points=Ke({},{size:R,width:Ln(1,R*.2),stroke:_.stroke,space:R*2,paths:C_,_stroke:null,_fill:null},_.points);L.show=ue(L.show),L.filter=ue(L.filter),L.fill=ue(L.fill),L.stroke=ue(L.stroke),L.paths=ue(L.paths),L.pxAlign=_.pxAlign}if(ie){let R=be(_,M);yt.splice(M,0,R[0]),te.splice(M,0,R[1]),Mt.values.push(null)}if(Qt){xt.splice(M,0,null);let R=null;Si?M==0&&(R=oo(_,M)):M>0&&(R=oo(_,M)),Tn.splice(M,0,R),Fi.splice(M,0,0),ci.splice(M,0,0)}pn("addSeries",M)}function sa(_,M){M=M??w.length,_=s==1?sh(_,M,Zd,tf):sh(_,M,{},Qd),w.splice(M,0,_),Rs(w[M],M)}n.addSeries=sa;function ra(_){if(w.splice(_,1),ie){Mt.values.splice(_,1),te.splice(_,1);let M=yt.splice(_,1)[0];Be(null,M.firstChild),M.remove()}Qt&&(xt.splice(_,1),Tn.splice(_,1)[0].remove(),Fi.splice(_,1),ci.splice(_,1)),pn("delSeries",_)}n.delSeries=ra;let Oi=[!1,!1,!1,!1];function wc(_,M){if(_._show=_.show,_.show){let R=_.side%2,L=v[_.scale];L==null&&(_.scale=R?w[1].scale:A,L=v[_.scale]);let k=L.time;_.size=ue(_.size),_.space=ue(_.space),_.rotate=ue(_.rotate),as(_.incrs)&&_.incrs.forEach(it=>{!ls.has(it)&&ls.set(it,gf(it))}),_.incrs=ue(_.incrs||(L.distr==2?z0:k?p==1?H0:X0:Fs)),_.splits=ue(_.splits||(k&&L.distr==1?K:L.distr==3?th:L.distr==4?c_:l_)),_.stroke=ue(_.stroke),_.grid.stroke=ue(_.grid.stroke),_.ticks.stroke=ue(_.ticks.stroke),_.border.stroke=ue(_.border.stroke);let q=_.values;_.values=as(q)&&!as(q[0])?ue(q):k?as(q)?Xd(Y,Wd(q,j)):zd(q)?$0(Y,q):q||at:q||a_,_.filter=ue(_.filter||(L.distr>=3&&L.log==10?d_:L.distr==3&&L.log==2?f_:pf)),_.font=af(_.font),_.labelFont=af(_.labelFont),_._size=_.size(n,null,M,0),_._space=_._rotate=_._incrs=_._found=_._splits=_._values=null,_._size>0&&(Oi[M]=!0,_._el=ni(Jg,d))}}function Cs(_,M,R,L){let[k,q,it,ct]=R,mt=M%2,Tt=0;return mt==0&&(ct||q)&&(Tt=M==0&&!k||M==2&&!it?sn($d.size/3):0),mt==1&&(k||it)&&(Tt=M==1&&!q||M==3&&!ct?sn(Kd.size/2):0),Tt}let oa=n.padding=(i.padding||[Cs,Cs,Cs,Cs]).map(_=>ue(_e(_,Cs))),wi=n._padding=oa.map((_,M)=>_(n,M,Oi,0)),en,T=null,V=null,J=s==1?w[0].idxs:null,$=null,G=!1;function ft(_,M){if(t=_??[],n.data=n._data=t,s==2){en=0;for(let R=1;R<w.length;R++)en+=t[R][0].length}else{t.length==0&&(n.data=n._data=t=[[]]),$=t[0],en=$.length;let R=t;if(O==2){R=t.slice();let L=R[0]=Array(en);for(let k=0;k<en;k++)L[k]=k}n._data=t=R}if(ar(!0),pn("setData"),O==2&&(Kt=!0),M!==!1){let R=P;R.auto(n,G)?bt():ss(A,R.min,R.max),B=B||_t.left>=0,pt=!0,lr()}}n.setData=ft;function bt(){G=!0;let _,M;s==1&&(en>0?(T=J[0]=0,V=J[1]=en-1,_=t[0][T],M=t[0][V],O==2?(_=T,M=V):_==M&&(O==3?[_,M]=Ma(_,_,P.log,!1):O==4?[_,M]=lh(_,_,P.log,!1):P.time?M=_+sn(86400/p):[_,M]=xa(_,M,ch,!0))):(T=J[0]=_=null,V=J[1]=M=null)),ss(A,_,M)}let Lt,Et,Xt,qt,zt,oe,me,Ne,Se,se;function Wt(_,M,R,L,k,q){_??=Sd,R??=uh,L??="butt",k??=Sd,q??="round",_!=Lt&&(u.strokeStyle=Lt=_),k!=Et&&(u.fillStyle=Et=k),M!=Xt&&(u.lineWidth=Xt=M),q!=zt&&(u.lineJoin=zt=q),L!=oe&&(u.lineCap=oe=L),R!=qt&&u.setLineDash(qt=R)}function Ue(_,M,R,L){M!=Et&&(u.fillStyle=Et=M),_!=me&&(u.font=me=_),R!=Ne&&(u.textAlign=Ne=R),L!=Se&&(u.textBaseline=Se=L)}function he(_,M,R,L,k=0){if(L.length>0&&_.auto(n,G)&&(M==null||M.min==null)){let q=_e(T,0),it=_e(V,L.length-1),ct=R.min==null?d0(L,q,it,k,_.distr==3):[R.min,R.max];_.min=mi(_.min,R.min=ct[0]),_.max=Ln(_.max,R.max=ct[1])}}let Mn={min:null,max:null};function es(){for(let L in v){let k=v[L];X[L]==null&&(k.min==null||X[A]!=null&&k.auto(n,G))&&(X[L]=Mn)}for(let L in v){let k=v[L];X[L]==null&&k.from!=null&&X[k.from]!=null&&(X[L]=Mn)}X[A]!=null&&ar(!0);let _={};for(let L in X){let k=X[L];if(k!=null){let q=_[L]=br(v[L],M0);if(k.min!=null)Ke(q,k);else if(L!=A||s==2)if(en==0&&q.from==null){let it=q.range(n,null,null,L);q.min=it[0],q.max=it[1]}else q.min=Ie,q.max=-Ie}}if(en>0){w.forEach((L,k)=>{if(s==1){let q=L.scale,it=X[q];if(it==null)return;let ct=_[q];if(k==0){let mt=ct.range(n,ct.min,ct.max,q);ct.min=mt[0],ct.max=mt[1],T=pi(ct.min,t[0]),V=pi(ct.max,t[0]),V-T>1&&(t[0][T]<ct.min&&T++,t[0][V]>ct.max&&V--),L.min=$[T],L.max=$[V]}else L.show&&L.auto&&he(ct,it,L,t[k],L.sorted);L.idxs[0]=T,L.idxs[1]=V}else if(k>0&&L.show&&L.auto){let[q,it]=L.facets,ct=q.scale,mt=it.scale,[Tt,Rt]=t[k],Dt=_[ct],ne=_[mt];Dt!=null&&he(Dt,X[ct],q,Tt,q.sorted),ne!=null&&he(ne,X[mt],it,Rt,it.sorted),L.min=it.min,L.max=it.max}});for(let L in _){let k=_[L],q=X[L];if(k.from==null&&(q==null||q.min==null)){let it=k.range(n,k.min==Ie?null:k.min,k.max==-Ie?null:k.max,L);k.min=it[0],k.max=it[1]}}}for(let L in _){let k=_[L];if(k.from!=null){let q=_[k.from];if(q.min==null)k.min=k.max=null;else{let it=k.range(n,q.min,q.max,L);k.min=it[0],k.max=it[1]}}}let M={},R=!1;for(let L in _){let k=_[L],q=v[L];if(q.min!=k.min||q.max!=k.max){q.min=k.min,q.max=k.max;let it=q.distr;q._min=it==3?ki(q.min):it==4?Xc(q.min,q.asinh):it==100?q.fwd(q.min):q.min,q._max=it==3?ki(q.max):it==4?Xc(q.max,q.asinh):it==100?q.fwd(q.max):q.max,M[L]=R=!0}}if(R){w.forEach((L,k)=>{s==2?k>0&&M.y&&(L._paths=null):M[L.scale]&&(L._paths=null)});for(let L in M)Kt=!0,pn("setScale",L);Qt&&_t.left>=0&&(B=pt=!0)}for(let L in X)X[L]=null}function An(_){let M=Qc(T-1,0,en-1),R=Qc(V+1,0,en-1);for(;_[M]==null&&M>0;)M--;for(;_[R]==null&&R<en-1;)R++;return[M,R]}function Ps(){if(en>0){let _=w.some(M=>M._focus)&&se!=Gn.alpha;_&&(u.globalAlpha=se=Gn.alpha),w.forEach((M,R)=>{if(R>0&&M.show&&(Fe(R,!1),Fe(R,!0),M._paths==null)){let L=se;se!=M.alpha&&(u.globalAlpha=se=M.alpha);let k=s==2?[0,t[R][0].length-1]:An(t[R]);M._paths=M.paths(n,R,k[0],k[1]),se!=L&&(u.globalAlpha=se=L)}}),w.forEach((M,R)=>{if(R>0&&M.show){let L=se;se!=M.alpha&&(u.globalAlpha=se=M.alpha),M._paths!=null&&Rn(R,!1);{let k=M._paths!=null?M._paths.gaps:null,q=M.points.show(n,R,T,V,k),it=M.points.filter(n,R,q,k);(q||it)&&(M.points._paths=M.points.paths(n,R,T,V,it),Rn(R,!0))}se!=L&&(u.globalAlpha=se=L),pn("drawSeries",R)}}),_&&(u.globalAlpha=se=1)}}function Fe(_,M){let R=M?w[_].points:w[_];R._stroke=R.stroke(n,_),R._fill=R.fill(n,_)}function Rn(_,M){let R=M?w[_].points:w[_],{stroke:L,fill:k,clip:q,flags:it,_stroke:ct=R._stroke,_fill:mt=R._fill,_width:Tt=R.width}=R._paths;Tt=Le(Tt*ve,3);let Rt=null,Dt=Tt%2/2;M&&mt==null&&(mt=Tt>0?"#fff":ct);let ne=R.pxAlign==1&&Dt>0;if(ne&&u.translate(Dt,Dt),!M){let ye=At-Tt/2,ge=ot-Tt/2,ce=gt+Tt,Zt=Bt+Tt;Rt=new Path2D,Rt.rect(ye,ge,ce,Zt)}M?un(ct,Tt,R.dash,R.cap,mt,L,k,it,q):Bn(_,ct,Tt,R.dash,R.cap,mt,L,k,it,Rt,q),ne&&u.translate(-Dt,-Dt)}function Bn(_,M,R,L,k,q,it,ct,mt,Tt,Rt){let Dt=!1;mt!=0&&C.forEach((ne,ye)=>{if(ne.series[0]==_){let ge=w[ne.series[1]],ce=t[ne.series[1]],Zt=(ge._paths||vo).band;as(Zt)&&(Zt=ne.dir==1?Zt[0]:Zt[1]);let Vt,Ve=null;ge.show&&Zt&&p0(ce,T,V)?(Ve=ne.fill(n,ye)||q,Vt=ge._paths.clip):Zt=null,un(M,R,L,k,Ve,it,ct,mt,Tt,Rt,Vt,Zt),Dt=!0}}),Dt||un(M,R,L,k,q,it,ct,mt,Tt,Rt)}let hn=Sr|nh;function un(_,M,R,L,k,q,it,ct,mt,Tt,Rt,Dt){Wt(_,M,R,L,k),(mt||Tt||Dt)&&(u.save(),mt&&u.clip(mt),Tt&&u.clip(Tt)),Dt?(ct&hn)==hn?(u.clip(Dt),Rt&&u.clip(Rt),Qn(k,it),ns(_,q,M)):ct&nh?(Qn(k,it),u.clip(Dt),ns(_,q,M)):ct&Sr&&(u.save(),u.clip(Dt),Rt&&u.clip(Rt),Qn(k,it),u.restore(),ns(_,q,M)):(Qn(k,it),ns(_,q,M)),(mt||Tt||Dt)&&u.restore()}function ns(_,M,R){R>0&&(M instanceof Map?M.forEach((L,k)=>{u.strokeStyle=Lt=k,u.stroke(L)}):M!=null&&_&&u.stroke(M))}function Qn(_,M){M instanceof Map?M.forEach((R,L)=>{u.fillStyle=Et=L,u.fill(R)}):M!=null&&_&&u.fill(M)}function ng(_,M,R,L){let k=E[_],q;if(L<=0)q=[0,0];else{let it=k._space=k.space(n,_,M,R,L),ct=k._incrs=k.incrs(n,_,M,R,L,it);q=U_(M,R,ct,L,it)}return k._found=q}function Ec(_,M,R,L,k,q,it,ct,mt,Tt){let Rt=it%2/2;x==1&&u.translate(Rt,Rt),Wt(ct,it,mt,Tt,ct),u.beginPath();let Dt,ne,ye,ge,ce=k+(L==0||L==3?-q:q);R==0?(ne=k,ge=ce):(Dt=k,ye=ce);for(let Zt=0;Zt<_.length;Zt++)M[Zt]!=null&&(R==0?Dt=ye=_[Zt]:ne=ge=_[Zt],u.moveTo(Dt,ne),u.lineTo(ye,ge));u.stroke(),x==1&&u.translate(-Rt,-Rt)}function ig(_){let M=!0;return E.forEach((R,L)=>{if(!R.show)return;let k=v[R.scale];if(k.min==null){R._show&&(M=!1,R._show=!1,ar(!1));return}else R._show||(M=!1,R._show=!0,ar(!1));let q=R.side,it=q%2,{min:ct,max:mt}=k,[Tt,Rt]=ng(L,ct,mt,it==0?y:F);if(Rt==0)return;let Dt=k.distr==2,ne=R._splits=R.splits(n,L,ct,mt,Tt,Rt,Dt),ye=k.distr==2?ne.map(Vt=>$[Vt]):ne,ge=k.distr==2?$[ne[1]]-$[ne[0]]:Tt,ce=R._values=R.values(n,R.filter(n,ye,L,Rt,ge),L,Rt,ge);R._rotate=q==2?R.rotate(n,ce,L,Rt):0;let Zt=R._size;R._size=ii(R.size(n,ce,L,_)),Zt!=null&&R._size!=Zt&&(M=!1)}),M}function sg(_){let M=!0;return oa.forEach((R,L)=>{let k=R(n,L,Oi,_);k!=wi[L]&&(M=!1),wi[L]=k}),M}function rg(){for(let _=0;_<E.length;_++){let M=E[_];if(!M.show||!M._show)continue;let R=M.side,L=R%2,k,q,it=M.stroke(n,_),ct=R==0||R==3?-1:1,[mt,Tt]=M._found;if(M.label!=null){let Pn=M.labelGap*ct,qn=sn((M._lpos+Pn)*ve);Ue(M.labelFont[0],it,"center",R==2?"top":bd),u.save(),L==1?(k=q=0,u.translate(qn,sn(ot+Bt/2)),u.rotate((R==3?-ga:ga)/2)):(k=sn(At+gt/2),q=qn);let Ds=df(M.label)?M.label(n,_,mt,Tt):M.label;u.fillText(Ds,k,q),u.restore()}if(Tt==0)continue;let Rt=v[M.scale],Dt=L==0?gt:Bt,ne=L==0?At:ot,ye=M._splits,ge=Rt.distr==2?ye.map(Pn=>$[Pn]):ye,ce=Rt.distr==2?$[ye[1]]-$[ye[0]]:mt,Zt=M.ticks,Vt=M.border,Ve=Zt.show?Zt.size:0,Ye=sn(Ve*ve),mn=sn((M.alignTo==2?M._size-Ve-M.gap:M.gap)*ve),Ae=M._rotate*-ga/180,$e=m(M._pos*ve),Wn=(Ye+mn)*ct,Cn=$e+Wn;q=L==0?Cn:0,k=L==1?Cn:0;let ti=M.font[0],hi=M.align==1?_r:M.align==2?Hc:Ae>0?_r:Ae<0?Hc:L==0?"center":R==3?Hc:_r,Ai=Ae||L==1?"middle":R==2?"top":bd;Ue(ti,it,hi,Ai);let Xn=M.font[1]*M.lineGap,ei=ye.map(Pn=>m(a(Pn,Rt,Dt,ne))),ui=M._values;for(let Pn=0;Pn<ui.length;Pn++){let qn=ui[Pn];if(qn!=null){L==0?k=ei[Pn]:q=ei[Pn],qn=""+qn;let Ds=qn.indexOf(`
`)==-1?[qn]:qn.split(/\n/gm);for(let In=0;In<Ds.length;In++){let nd=Ds[In];Ae?(u.save(),u.translate(k,q+In*Xn),u.rotate(Ae),u.fillText(nd,0,0),u.restore()):u.fillText(nd,k,q+In*Xn)}}}Zt.show&&Ec(ei,Zt.filter(n,ge,_,Tt,ce),L,R,$e,Ye,Le(Zt.width*ve,3),Zt.stroke(n,_),Zt.dash,Zt.cap);let Ri=M.grid;Ri.show&&Ec(ei,Ri.filter(n,ge,_,Tt,ce),L,L==0?2:1,L==0?ot:At,L==0?Bt:gt,Le(Ri.width*ve,3),Ri.stroke(n,_),Ri.dash,Ri.cap),Vt.show&&Ec([$e],[1],L==0?1:0,L==0?1:2,L==1?ot:At,L==1?Bt:gt,Le(Vt.width*ve,3),Vt.stroke(n,_),Vt.dash,Vt.cap)}pn("drawAxes")}function ar(_){w.forEach((M,R)=>{R>0&&(M._paths=null,_&&(s==1?(M.min=null,M.max=null):M.facets.forEach(L=>{L.min=null,L.max=null})))})}let aa=!1,Tc=!1,ao=[];function og(){Tc=!1;for(let _=0;_<ao.length;_++)pn(...ao[_]);ao.length=0}function lr(){aa||(R0(Bu),aa=!0)}function ag(_,M=!1){aa=!0,Tc=M,_(n),Bu(),M&&ao.length>0&&queueMicrotask(og)}n.batch=ag;function Bu(){if(Ot&&(es(),Ot=!1),Kt&&(Ft(),Kt=!1),vt){if(He(f,_r,Z),He(f,"top",nt),He(f,go,y),He(f,_o,F),He(g,_r,Z),He(g,"top",nt),He(g,go,y),He(g,_o,F),He(d,go,xe),He(d,_o,I),h.width=sn(xe*ve),h.height=sn(I*ve),E.forEach(({_el:_,_show:M,_size:R,_pos:L,side:k})=>{if(_!=null)if(M){let q=k===3||k===0?R:0,it=k%2==1;He(_,it?"left":"top",L-q),He(_,it?"width":"height",R),He(_,it?"top":"left",it?nt:Z),He(_,it?"height":"width",it?F:y),Kc(_,Os)}else Yn(_,Os)}),Lt=Et=Xt=zt=oe=me=Ne=Se=qt=null,se=1,ho(!0),Z!=tt||nt!=Ut||y!=ut||F!=It){ar(!1);let _=y/ut,M=F/It;if(Qt&&!B&&_t.left>=0){_t.left*=_,_t.top*=M,cr&&Ci(cr,sn(_t.left),0,y,F),hr&&Ci(hr,0,sn(_t.top),y,F);for(let R=0;R<Tn.length;R++){let L=Tn[R];L!=null&&(Fi[R]*=_,ci[R]*=M,Ci(L,ii(Fi[R]),ii(ci[R]),y,F))}}if(ze.show&&!dt&&ze.left>=0&&ze.width>0){ze.left*=_,ze.width*=_,ze.top*=M,ze.height*=M;for(let R in Lc)He(fr,R,ze[R])}tt=Z,Ut=nt,ut=y,It=F}pn("setSize"),vt=!1}xe>0&&I>0&&(u.clearRect(0,0,h.width,h.height),pn("drawClear"),U.forEach(_=>_()),pn("draw")),ze.show&&dt&&(la(ze),dt=!1),Qt&&B&&(Ls(null,!0,!1),B=!1),Mt.show&&Mt.live&&pt&&(Pc(),pt=!1),c||(c=!0,n.status=1,pn("ready")),G=!1,aa=!1}n.redraw=(_,M)=>{Kt=M||!1,_!==!1?ss(A,P.min,P.max):lr()};function Ac(_,M){let R=v[_];if(R.from==null){if(en==0){let L=R.range(n,M.min,M.max,_);M.min=L[0],M.max=L[1]}if(M.min>M.max){let L=M.min;M.min=M.max,M.max=L}if(en>1&&M.min!=null&&M.max!=null&&M.max-M.min<1e-16)return;_==A&&R.distr==2&&en>0&&(M.min=pi(M.min,t[0]),M.max=pi(M.max,t[0]),M.min==M.max&&M.max++),X[_]=M,Ot=!0,lr()}}n.setScale=Ac;let Rc,Cc,cr,hr,ku,zu,ur,dr,Vu,Hu,ke,Xe,is=!1,yn=_t.drag,dn=yn.x,fn=yn.y;Qt&&(_t.x&&(Rc=ni(jg,g)),_t.y&&(Cc=ni(Qg,g)),P.ori==0?(cr=Rc,hr=Cc):(cr=Cc,hr=Rc),ke=_t.left,Xe=_t.top);let ze=n.select=Ke({show:!0,over:!0,left:0,width:0,top:0,height:0},i.select),fr=ze.show?ni(Kg,ze.over?g:f):null;function la(_,M){if(ze.show){for(let R in _)ze[R]=_[R],R in Lc&&He(fr,R,_[R]);M!==!1&&pn("setSelect")}}n.setSelect=la;function lg(_){if(w[_].show)ie&&Kc(yt[_],Os);else if(ie&&Yn(yt[_],Os),Qt){let R=Si?Tn[0]:Tn[_];R!=null&&Ci(R,-10,-10,y,F)}}function ss(_,M,R){Ac(_,{min:M,max:R})}function Ei(_,M,R,L){M.focus!=null&&fg(_),M.show!=null&&w.forEach((k,q)=>{q>0&&(_==q||_==null)&&(k.show=M.show,lg(q),s==2?(ss(k.facets[0].scale,null,null),ss(k.facets[1].scale,null,null)):ss(k.scale,null,null),lr())}),R!==!1&&pn("setSeries",_,M),L&&uo("setSeries",n,_,M)}n.setSeries=Ei;function cg(_,M){Ke(C[_],M)}function hg(_,M){_.fill=ue(_.fill||null),_.dir=_e(_.dir,-1),M=M??C.length,C.splice(M,0,_)}function ug(_){_==null?C.length=0:C.splice(_,1)}n.addBand=hg,n.setBand=cg,n.delBand=ug;function dg(_,M){w[_].alpha=M,Qt&&Tn[_]!=null&&(Tn[_].style.opacity=M),ie&&yt[_]&&(yt[_].style.opacity=M)}let Bi,rs,Is,pr={focus:!0};function fg(_){if(_!=Is){let M=_==null,R=Gn.alpha!=1;w.forEach((L,k)=>{if(s==1||k>0){let q=M||k==0||k==_;L._focus=M?null:q,R&&dg(k,q?1:Gn.alpha)}}),Is=_,R&&lr()}}ie&&On&&Ht(Td,et,_=>{_t._lock||(xn(_),Is!=null&&Ei(null,pr,!0,Je.setSeries))});function Ti(_,M,R){let L=v[M];R&&(_=_/ve-(L.ori==1?nt:Z));let k=y;L.ori==1&&(k=F,_=k-_),L.dir==-1&&(_=k-_);let q=L._min,it=L._max,ct=_/k,mt=q+(it-q)*ct,Tt=L.distr;return Tt==3?vr(10,mt):Tt==4?g0(mt,L.asinh):Tt==100?L.bwd(mt):mt}function pg(_,M){let R=Ti(_,A,M);return pi(R,t[0],T,V)}n.valToIdx=_=>pi(_,t[0]),n.posToIdx=pg,n.posToVal=Ti,n.valToPos=(_,M,R)=>v[M].ori==0?r(_,v[M],R?gt:y,R?At:0):o(_,v[M],R?Bt:F,R?ot:0),n.setCursor=(_,M,R)=>{ke=_.left,Xe=_.top,Ls(null,M,R)};function Gu(_,M){He(fr,_r,ze.left=_),He(fr,go,ze.width=M)}function Wu(_,M){He(fr,"top",ze.top=_),He(fr,_o,ze.height=M)}let lo=P.ori==0?Gu:Wu,co=P.ori==1?Gu:Wu;function mg(){if(ie&&Mt.live)for(let _=s==2?1:0;_<w.length;_++){if(_==0&&N)continue;let M=Mt.values[_],R=0;for(let L in M)te[_][R++].firstChild.nodeValue=M[L]}}function Pc(_,M){if(_!=null&&(_.idxs?_.idxs.forEach((R,L)=>{xt[L]=R}):v0(_.idx)||xt.fill(_.idx),Mt.idx=xt[0]),ie&&Mt.live){for(let R=0;R<w.length;R++)(R>0||s==1&&!N)&&gg(R,xt[R]);mg()}pt=!1,M!==!1&&pn("setLegend")}n.setLegend=Pc;function gg(_,M){let R=w[_],L=_==0&&O==2?$:t[_],k;N?k=R.values(n,_,M)??de:(k=R.value(n,M==null?null:L[M],_,M),k=k==null?de:{_:k}),Mt.values[_]=k}function Ls(_,M,R){Vu=ke,Hu=Xe,[ke,Xe]=_t.move(n,ke,Xe),_t.left=ke,_t.top=Xe,Qt&&(cr&&Ci(cr,sn(ke),0,y,F),hr&&Ci(hr,0,sn(Xe),y,F));let L,k=T>V;Bi=Ie,rs=null;let q=P.ori==0?y:F,it=P.ori==1?y:F;if(ke<0||en==0||k){L=_t.idx=null;for(let ct=0;ct<w.length;ct++){let mt=Tn[ct];mt!=null&&Ci(mt,-10,-10,y,F)}On&&Ei(null,pr,!0,_==null&&Je.setSeries),Mt.live&&(xt.fill(L),pt=!0)}else{let ct,mt,Tt;s==1&&(ct=P.ori==0?ke:Xe,mt=Ti(ct,A),L=_t.idx=pi(mt,t[0],T,V),Tt=z(t[0][L],P,q,0));let Rt=-10,Dt=-10,ne=0,ye=0,ge=!0,ce="",Zt="";for(let Vt=s==2?1:0;Vt<w.length;Vt++){let Ve=w[Vt],Ye=xt[Vt],mn=Ye==null?null:s==1?t[Vt][Ye]:t[Vt][1][Ye],Ae=_t.dataIdx(n,Vt,L,mt),$e=Ae==null?null:s==1?t[Vt][Ae]:t[Vt][1][Ae];if(pt=pt||$e!=mn||Ae!=Ye,xt[Vt]=Ae,Vt>0&&Ve.show){let Wn=Ae==null?-10:Ae==L?Tt:z(s==1?t[0][Ae]:t[Vt][0][Ae],P,q,0),Cn=$e==null?-10:W($e,s==1?v[Ve.scale]:v[Ve.facets[1].scale],it,0);if(On&&$e!=null){let ti=P.ori==1?ke:Xe,hi=rn(Gn.dist(n,Vt,Ae,Cn,ti));if(hi<Bi){let Ai=Gn.bias;if(Ai!=0){let Xn=Ti(ti,Ve.scale),ei=$e>=0?1:-1,ui=Xn>=0?1:-1;ui==ei&&(ui==1?Ai==1?$e>=Xn:$e<=Xn:Ai==1?$e<=Xn:$e>=Xn)&&(Bi=hi,rs=Vt)}else Bi=hi,rs=Vt}}if(pt||Si){let ti,hi;P.ori==0?(ti=Wn,hi=Cn):(ti=Cn,hi=Wn);let Ai,Xn,ei,ui,Ri,Pn,qn=!0,Ds=Pe.bbox;if(Ds!=null){qn=!1;let In=Ds(n,Vt);ei=In.left,ui=In.top,Ai=In.width,Xn=In.height}else ei=ti,ui=hi,Ai=Xn=Pe.size(n,Vt);if(Pn=Pe.fill(n,Vt),Ri=Pe.stroke(n,Vt),Si)Vt==rs&&Bi<=Gn.prox&&(Rt=ei,Dt=ui,ne=Ai,ye=Xn,ge=qn,ce=Pn,Zt=Ri);else{let In=Tn[Vt];In!=null&&(Fi[Vt]=ei,ci[Vt]=ui,Dd(In,Ai,Xn,qn),Id(In,Pn,Ri),Ci(In,ii(ei),ii(ui),y,F))}}}}if(Si){let Vt=Gn.prox,Ve=Is==null?Bi<=Vt:Bi>Vt||rs!=Is;if(pt||Ve){let Ye=Tn[0];Ye!=null&&(Fi[0]=Rt,ci[0]=Dt,Dd(Ye,ne,ye,ge),Id(Ye,ce,Zt),Ci(Ye,ii(Rt),ii(Dt),y,F))}}}if(ze.show&&is)if(_!=null){let[ct,mt]=Je.scales,[Tt,Rt]=Je.match,[Dt,ne]=_.cursor.sync.scales,ye=_.cursor.drag;if(dn=ye._x,fn=ye._y,dn||fn){let{left:ge,top:ce,width:Zt,height:Vt}=_.select,Ve=_.scales[Dt].ori,Ye=_.posToVal,mn,Ae,$e,Wn,Cn,ti=ct!=null&&Tt(ct,Dt),hi=mt!=null&&Rt(mt,ne);ti&&dn?(Ve==0?(mn=ge,Ae=Zt):(mn=ce,Ae=Vt),$e=v[ct],Wn=z(Ye(mn,Dt),$e,q,0),Cn=z(Ye(mn+Ae,Dt),$e,q,0),lo(mi(Wn,Cn),rn(Cn-Wn))):lo(0,q),hi&&fn?(Ve==1?(mn=ge,Ae=Zt):(mn=ce,Ae=Vt),$e=v[mt],Wn=W(Ye(mn,ne),$e,it,0),Cn=W(Ye(mn+Ae,ne),$e,it,0),co(mi(Wn,Cn),rn(Cn-Wn))):co(0,it)}else Dc()}else{let ct=rn(Vu-ku),mt=rn(Hu-zu);if(P.ori==1){let ne=ct;ct=mt,mt=ne}dn=yn.x&&ct>=yn.dist,fn=yn.y&&mt>=yn.dist;let Tt=yn.uni;Tt!=null?dn&&fn&&(dn=ct>=Tt,fn=mt>=Tt,!dn&&!fn&&(mt>ct?fn=!0:dn=!0)):yn.x&&yn.y&&(dn||fn)&&(dn=fn=!0);let Rt,Dt;dn&&(P.ori==0?(Rt=ur,Dt=ke):(Rt=dr,Dt=Xe),lo(mi(Rt,Dt),rn(Dt-Rt)),fn||co(0,it)),fn&&(P.ori==1?(Rt=ur,Dt=ke):(Rt=dr,Dt=Xe),co(mi(Rt,Dt),rn(Dt-Rt)),dn||lo(0,q)),!dn&&!fn&&(lo(0,0),co(0,0))}if(yn._x=dn,yn._y=fn,_==null){if(R){if(ed!=null){let[ct,mt]=Je.scales;Je.values[0]=ct!=null?Ti(P.ori==0?ke:Xe,ct):null,Je.values[1]=mt!=null?Ti(P.ori==1?ke:Xe,mt):null}uo(Gc,n,ke,Xe,y,F,L)}if(On){let ct=R&&Je.setSeries,mt=Gn.prox;Is==null?Bi<=mt&&Ei(rs,pr,!0,ct):Bi>mt?Ei(null,pr,!0,ct):rs!=Is&&Ei(rs,pr,!0,ct)}}pt&&(Mt.idx=L,Pc()),M!==!1&&pn("setCursor")}let os=null;Object.defineProperty(n,"rect",{get(){return os==null&&ho(!1),os}});function ho(_=!1){_?os=null:(os=g.getBoundingClientRect(),pn("syncRect",os))}function Xu(_,M,R,L,k,q,it){_t._lock||is&&_!=null&&_.movementX==0&&_.movementY==0||(Ic(_,M,R,L,k,q,it,!1,_!=null),_!=null?Ls(null,!0,!0):Ls(M,!0,!1))}function Ic(_,M,R,L,k,q,it,ct,mt){if(os==null&&ho(!1),xn(_),_!=null)R=_.clientX-os.left,L=_.clientY-os.top;else{if(R<0||L<0){ke=-10,Xe=-10;return}let[Tt,Rt]=Je.scales,Dt=M.cursor.sync,[ne,ye]=Dt.values,[ge,ce]=Dt.scales,[Zt,Vt]=Je.match,Ve=M.axes[0].side%2==1,Ye=P.ori==0?y:F,mn=P.ori==1?y:F,Ae=Ve?q:k,$e=Ve?k:q,Wn=Ve?L:R,Cn=Ve?R:L;if(ge!=null?R=Zt(Tt,ge)?a(ne,v[Tt],Ye,0):-10:R=Ye*(Wn/Ae),ce!=null?L=Vt(Rt,ce)?a(ye,v[Rt],mn,0):-10:L=mn*(Cn/$e),P.ori==1){let ti=R;R=L,L=ti}}mt&&(M==null||M.cursor.event.type==Gc)&&((R<=1||R>=y-1)&&(R=Us(R,y)),(L<=1||L>=F-1)&&(L=Us(L,F))),ct?(ku=R,zu=L,[ur,dr]=_t.move(n,R,L)):(ke=R,Xe=L)}let Lc={width:0,height:0,left:0,top:0};function Dc(){la(Lc,!1)}let qu,Yu,$u,Zu;function Ju(_,M,R,L,k,q,it){is=!0,dn=fn=yn._x=yn._y=!1,Ic(_,M,R,L,k,q,it,!0,!1),_!=null&&(Ht(Wc,Zc,Ku,!1),uo(wd,n,ur,dr,y,F,null));let{left:ct,top:mt,width:Tt,height:Rt}=ze;qu=ct,Yu=mt,$u=Tt,Zu=Rt}function Ku(_,M,R,L,k,q,it){is=yn._x=yn._y=!1,Ic(_,M,R,L,k,q,it,!1,!0);let{left:ct,top:mt,width:Tt,height:Rt}=ze,Dt=Tt>0||Rt>0,ne=qu!=ct||Yu!=mt||$u!=Tt||Zu!=Rt;if(Dt&&ne&&la(ze),yn.setScale&&Dt&&ne){let ye=ct,ge=Tt,ce=mt,Zt=Rt;if(P.ori==1&&(ye=mt,ge=Rt,ce=ct,Zt=Tt),dn&&ss(A,Ti(ye,A),Ti(ye+ge,A)),fn)for(let Vt in v){let Ve=v[Vt];Vt!=A&&Ve.from==null&&Ve.min!=Ie&&ss(Vt,Ti(ce+Zt,Vt),Ti(ce,Vt))}Dc()}else _t.lock&&(_t._lock=!_t._lock,Ls(M,!0,_!=null));_!=null&&(Be(Wc,Zc),uo(Wc,n,ke,Xe,y,F,null))}function _g(_,M,R,L,k,q,it){if(_t._lock)return;xn(_);let ct=is;if(is){let mt=!0,Tt=!0,Rt=10,Dt,ne;P.ori==0?(Dt=dn,ne=fn):(Dt=fn,ne=dn),Dt&&ne&&(mt=ke<=Rt||ke>=y-Rt,Tt=Xe<=Rt||Xe>=F-Rt),Dt&&mt&&(ke=ke<ur?0:y),ne&&Tt&&(Xe=Xe<dr?0:F),Ls(null,!0,!0),is=!1}ke=-10,Xe=-10,xt.fill(null),Ls(null,!0,!0),ct&&(is=ct)}function ju(_,M,R,L,k,q,it){_t._lock||(xn(_),bt(),Dc(),_!=null&&uo(Ad,n,ke,Xe,y,F,null))}function Qu(){E.forEach(F_),Pt(n.width,n.height,!0)}Bs(_a,yr,Qu);let mr={};mr.mousedown=Ju,mr.mousemove=Xu,mr.mouseup=Ku,mr.dblclick=ju,mr.setSeries=(_,M,R,L)=>{let k=Je.match[2];R=k(n,M,R),R!=-1&&Ei(R,L,!0,!1)},Qt&&(Ht(wd,g,Ju),Ht(Gc,g,Xu),Ht(Ed,g,_=>{xn(_),ho(!1)}),Ht(Td,g,_g),Ht(Ad,g,ju),ih.add(n),n.syncRect=ho);let ca=n.hooks=i.hooks||{};function pn(_,M,R){Tc?ao.push([_,M,R]):_ in ca&&ca[_].forEach(L=>{L.call(null,n,M,R)})}(i.plugins||[]).forEach(_=>{for(let M in _.hooks)ca[M]=(ca[M]||[]).concat(_.hooks[M])});let td=(_,M,R)=>R,Je=Ke({key:null,setSeries:!1,filters:{pub:Bd,sub:Bd},scales:[A,w[1]?w[1].scale:null],match:[kd,kd,td],values:[null,null]},_t.sync);Je.match.length==2&&Je.match.push(td),_t.sync=Je;let ed=Je.key,Nc=Ff(ed);function uo(_,M,R,L,k,q,it){Je.filters.pub(_,M,R,L,k,q,it)&&Nc.pub(_,M,R,L,k,q,it)}Nc.sub(n);function xg(_,M,R,L,k,q,it){Je.filters.sub(_,M,R,L,k,q,it)&&mr[_](null,M,R,L,k,q,it)}n.pub=xg;function yg(){Nc.unsub(n),ih.delete(n),Ct.clear(),jc(_a,yr,Qu),l.remove(),et?.remove(),pn("destroy")}n.destroy=yg;function Uc(){pn("init",i,t),ft(t||i.data,!1),X[A]?Ac(A,X[A]):bt(),dt=ze.show&&(ze.width>0||ze.height>0),B=pt=!0,Pt(i.width,i.height)}return w.forEach(Rs),E.forEach(wc),e?e instanceof HTMLElement?(e.appendChild(l),Uc()):e(n,Uc):Uc(),n}vn.assign=Ke;vn.fmtNum=hh;vn.rangeNum=xa;vn.rangeLog=Ma;vn.rangeAsinh=lh;vn.orient=zs;vn.pxRatio=ve;vn.join=A0;vn.fmtDate=dh,vn.tzDate=B0;vn.sync=Ff;{vn.addGap=v_,vn.clipGaps=wa;let i=vn.paths={points:Hf};i.linear=Wf,i.stepped=S_,i.bars=w_,i.spline=T_}var $f=40,O_=5,Zf=104,yh=.85,B_={rms:"RMS over agents",mean:"mean"},Kf=["#c2379b","#d55e00"],Ra=class extends EventTarget{constructor(t,e,n){super(),Object.assign(this,{run:t,clock:e,home:n}),this.lit=-1,this.all=[...t.said.agents.keys()],this.panels=k_(t).map(s=>this.make(s)),e.addEventListener("time",()=>this.moveNow()),new ResizeObserver(()=>this.resize()).observe(n)}make(t){let{run:e}=this,n=document.createElement("figure"),s=document.createElement("figcaption"),r=document.createElement("b");r.textContent=t.title;let o=document.createElement("span");o.textContent=t.unit,t.reading=document.createElement("output");let c=[...(t.bounds??[]).map((g,x)=>[`bound: ${g}`,Kf[x%2]]),...(t.limits??[]).filter(({near:g})=>g).map(({name:g})=>[g,"var(--quiet)"]),...(t.others??[]).map(({name:g,colour:x})=>[`team of ${g}`,x])].map(([g,x])=>{let m=document.createElement("span"),p=document.createElement("bdi");return p.textContent=g,m.append("\u2504 ",p),m.style.color=x,m});s.append(r,o,...c,t.reading);let l=document.createElement("div");l.className="plot",n.append(s,l),this.home.append(n),Object.assign(t,{box:n,plot:l,lines:Jf(e,t,this.all)}),n.setAttribute("role","img");let u=(t.lines.find(g=>g.name==="team")?.values??t.lines[0]?.values??[]).filter(g=>g!==null),d=u.length?`, from ${Yt(u[0])} to ${Yt(u[u.length-1])}`:"";n.setAttribute("aria-label",`${t.title}, ${t.unit}, over time${d}`);let f=g=>t.log&&!(g>0)?null:g;return t.data=[Array.from(e.time),...t.lines.map(g=>g.values.map(f))],t.u=new vn(this.options(t),t.data,l),t.now=document.createElement("div"),t.now.className="now",t.u.over.append(t.now),this.pointing(t),t}extend(){for(let e of this.panels){Jf(this.run,e,this.all).forEach(({values:s},r)=>e.lines[r]&&(e.lines[r].values=s));let n=s=>e.log&&!(s>0)?null:s;e.data=[Array.from(this.run.time),...e.lines.map(s=>s.values.map(n))]}let{lit:t}=this;this.lit=NaN;for(let e of this.panels)e.u.setData(e.data);this.light(t)}options(t){let e=s=>()=>getComputedStyle(document.documentElement).getPropertyValue(s).trim(),n={stroke:e("--quiet"),font:"10px system-ui",grid:{stroke:e("--rule"),width:1},ticks:{show:!1}};return{width:Math.max(this.home.clientWidth-24,200),height:Zf,padding:[4,18,0,0],legend:{show:!1},cursor:{y:!1,drag:{x:!1,y:!1,setScale:!1},points:{show:!1},focus:{prox:14}},focus:{alpha:.25},scales:{x:{time:!1,range:()=>[this.run.start,Math.max(this.run.end,this.run.start+1e-9)]},y:t.log?{distr:3,range:(s,r,o)=>G_(t,r,o)}:{range:(s,r,o)=>[0,W_(t,o)]}},axes:[{...n,size:18,gap:2,values:(s,r)=>r.map((o,a)=>`${+o.toFixed(6)}${a===r.length-1?" s":""}`)},{...n,size:42,gap:4,filter:(s,r)=>r,splits:t.log?(s,r,o,a)=>X_(o,a):void 0,values:(s,r)=>r.map(o=>o===null?"":q_(o))}],series:[{},...t.lines.map(s=>({label:"",stroke:s.colour.startsWith("--")?e(s.colour):s.agent>=0||s.group?()=>od(s.colour,document.documentElement.dataset.theme==="dark"):s.colour,width:s.width,dash:s.dash,alpha:s.alpha??1,points:{show:!1},spanGaps:!1}))],bands:t.lines.flatMap((s,r)=>s.bandTo?[{series:[r+1,t.lines.indexOf(s.bandTo)+1],fill:s.fill}]:[]),hooks:{draw:[s=>this.drawEvents(s)],setSeries:[(s,r)=>this.pointed(t,r)]}}}drawEvents(t){let e=getComputedStyle(document.documentElement);t.ctx.save(),t.ctx.strokeStyle=e.getPropertyValue("--quiet"),t.ctx.setLineDash([4,4]),t.ctx.lineWidth=1;for(let{time:n}of this.run.events){let s=Math.round(t.valToPos(n,"x",!0))+.5;t.ctx.beginPath(),t.ctx.moveTo(s,t.bbox.top),t.ctx.lineTo(s,t.bbox.top+t.bbox.height),t.ctx.stroke()}t.ctx.restore()}pointed(t,e){if(this.telling)return;let s=(e>0?t.lines[e-1]:null)?.agent??-1;s!==this.lit&&this.dispatchEvent(new CustomEvent("point",{detail:s}))}pointing(t){let{over:e}=t.u,n=s=>{let{left:r}=e.getBoundingClientRect();this.clock.pause(),this.clock.seek(t.u.posToVal(s.clientX-r,"x"))};e.addEventListener("pointerdown",s=>{s.button===0&&(e.setPointerCapture(s.pointerId),n(s))}),e.addEventListener("pointermove",s=>{s.buttons&1&&n(s)}),e.addEventListener("pointerleave",()=>this.dispatchEvent(new CustomEvent("point",{detail:-1})))}light(t){if(t>=this.run.agents&&(t=-1),t!==this.lit){this.lit=t,this.telling=!0;for(let e of this.panels){let n=e.lines.findIndex(o=>o.agent===t&&t>=0),s=e.lines.findIndex(o=>o.extra);if(s>=0){let o=a=>e.log&&!(a>0)?null:a;e.lines[s].agent=t,e.data[s+1]=t<0?this.run.said.time.map(()=>null):this.run.column(e.agents,t).map(o),e.u.setData(e.data,!1),e.u.redraw()}let r=e.lines.findIndex(o=>o.own);r>=0&&(e.data[r+1]=this.run.said.time.map((o,a)=>t<0?null:this.run.most(a,t)),e.u.setData(e.data,!1),e.u.redraw()),!(s>=0)&&(n>=0?e.u.setSeries(n+1,{focus:!0}):e.u.setSeries(null,{focus:!1}))}this.telling=!1,this.moveNow()}}moveNow(){let{run:t,clock:e}=this,[n]=t.locate(e.t);for(let s of this.panels){s.now.style.transform=`translateX(${s.u.valToPos(e.t,"x").toFixed(1)}px)`;let r=[],o=s.lines.find(c=>c.name==="team");o&&r.push(`${B_[s.how]??"team"} ${Yt(o.values[Math.min(n,o.values.length-1)])}`),s.agents&&this.lit>=0&&r.push(`${t.names[this.lit]} ${Yt(t.series[s.agents][n*t.agents+this.lit])}${s.limits?V_(t,n,this.lit):""}`);let a=r.join("   ");s.said!==a&&(s.reading.textContent=s.said=a)}}resize(){let t=Math.max(this.home.clientWidth-24,200);for(let{u:e}of this.panels)e.setSize({width:t,height:Zf});this.moveNow()}redraw(){for(let{u:t}of this.panels)t.redraw(!1,!0)}};function k_(i){let{said:t,series:e}=i,n=z_(i);return[{title:"Distance from its place",unit:"|q* \u2212 q|, m; of the team RMS over agents",agents:"tracking_error",how:"rms",log:!0,bounds:t.bounds,others:t.ghosts},e.apart&&{title:"Bodies from their ideal twins",unit:"m",agents:"apart",how:"rms",log:!0},{title:"Disagreement",unit:"|\u03B7|, m",agents:"disagreement",how:"mean",log:!0},{title:"Formation error",unit:"RMS over a group's links, m",team:"formation_error",groups:"group_formation_error",log:!0},{title:"Centering error",unit:"centre off its target, m",team:"centering_error",groups:"group_centering_error",log:!0},{title:"Speed asked for",unit:"m/s",agents:"speed",how:"mean",limits:n,log:H_(i)},e.saturation&&{title:"Thrusters at a limit",unit:"fraction of them",agents:"saturation",how:"mean",most:1}].filter(s=>s&&(s.agents||i.column(s.team,0).some(r=>r!==null)))}function z_(i){let{said:t}=i,e=c=>c.reduce((l,h)=>i.column("speed",h).reduce((u,d)=>Math.max(u,d??0),l),0),n=[...t.agents.keys()],s=t.kinds.flatMap(({name:c},l)=>{let h=n.filter(d=>t.kind[d]===l&&t.fastest[d]!==null&&Number.isFinite(t.fastest[d]));if(!h.length)return[];let u=t.fastest[h[0]];return[{name:`all-way speed of ${c} ${Yt(u)}`,at:()=>u,near:e(h)>yh*u}]}),r=t.limits.map(({limit:c})=>c.reduce((l,h)=>h===null?l:Math.min(l??h,h),null)),o=[...new Set(r.filter(c=>c!==null))],a=c=>r[t.limits.findLastIndex(({time:l},h)=>h===0||l<=i.time[c]+1e-9)];return o.length&&s.push({name:`limit of the law ${o.map(Yt).join(", ")}`,at:a,near:e(n)>yh*Math.min(...o)}),s}function V_(i,t,e){let n=i.most(t,e);return n===null?"":` of ${Yt(n)}`}function H_(i){let t=Float32Array.from(i.series.speed).sort();return t[t.length-1]>12*(t[t.length>>1]||1/0)}function Jf(i,t,e){let{said:n}=i,s=c=>n.groups[c].colour,r=i.said.time.map(()=>null),o=[];if(t.agents){if(e.length>$f){let c={values:i.over(t.agents,e,.05),colour:"transparent",width:0},l={values:i.over(t.agents,e,.95),colour:"transparent",width:0,bandTo:c,fill:"#5b8fd640"},h={values:i.over(t.agents,e,1),colour:"#5b8fd6",width:.8,alpha:.9};o.push(c,l,h)}else for(let c of e)o.push({values:i.column(t.agents,c),colour:s(i.groupOf[c]),width:1.1,alpha:.75,agent:c});e.length>1&&o.push({name:"team",values:i.over(t.agents,e,t.how),colour:"--ink",width:2}),e.length>$f&&o.push({values:r,colour:"#d9480f",width:1.8,extra:!0,agent:-1})}else n.formations.forEach((c,l)=>o.push({values:i.column(t.groups,l),colour:s(l),width:1.4,group:!0})),o.push({name:"team",values:i.column(t.team,0),colour:"--ink",width:2});t.bounds?.forEach((c,l)=>o.push({values:i.column(`bound${l}`,0),colour:Kf[l%2],width:1.6,dash:[7,4],bound:c})),t.others?.forEach(({colour:c},l)=>o.push({values:i.column(`ghost_error${l}`,0),colour:c??"--quiet",width:2,dash:[4,3]}));let a={colour:"--quiet",width:1.3,dash:[5,4],limit:!0};return t.limits?.filter(({near:c})=>c).forEach(({at:c})=>o.push({...a,values:r.map((l,h)=>c(h)),near:!0})),t.limits&&o.push({...a,values:r,own:!0}),o}function G_(i,t,e){let[n,s]=[1/0,0];for(let r of i.lines)if(!(r.bound||r.limit||r.fill||r.width===0))for(let o of r.values)o>0&&([n,s]=[Math.min(n,o),Math.max(s,o)]);for(let r of i.lines)if(r.bound)for(let o of r.values)o>0&&o<30*s&&(s=Math.max(s,o));return s>0?[Math.max(n,s/10**O_)/1.3,s*1.3]:[t||.1,e||1]}function W_(i,t){let e=0;for(let s of i.lines)if(!s.limit)for(let r of s.values)r>e&&(e=r);let n=e;for(let s of i.lines)if(s.near)for(let r of s.values)r!==null&&r*yh<n&&(e=Math.max(e,r));return i.most??(e>0?e*1.08:t||1)}function X_(i,t){for(let e of[[1],[1,3],[1,2,5],[1,1.5,2,3,4,5,6,8]]){let n=[];for(let s=Math.floor(Math.log10(i));s<=Math.ceil(Math.log10(t));s++)for(let r of e){let o=+`${r}e${s}`;o>=i&&o<=t&&n.push(o)}if(n.length>=3||n.length===2&&e.length>2)return n.filter((s,r)=>r%Math.ceil(n.length/4)===0)}return[i,t]}function q_(i){return i===0?"0":Math.abs(i)>=1e4||Math.abs(i)<.001?i.toExponential(0).replace("-","\u2212"):String(+i.toPrecision(3))}var ws={LEFT:0,MIDDLE:1,RIGHT:2,ROTATE:0,DOLLY:1,PAN:2},Es={ROTATE:0,PAN:1,DOLLY_PAN:2,DOLLY_ROTATE:3},xp=0,qh=1,yp=2;var Yh=1,vp=2,Di=3,Zi=0,Fn=1,Vn=2,Ki=0,qs=1,$h=2,Zh=3,Jh=4,Mp=5,_s=100,bp=101,Sp=102,wp=103,Ep=104,Tp=200,Ap=201,Rp=202,Cp=203,Za=204,Ja=205,Pp=206,Ip=207,Lp=208,Dp=209,Np=210,Up=211,Fp=212,Op=213,Bp=214,vl=0,Ml=1,bl=2,Ys=3,Sl=4,wl=5,El=6,Tl=7,Kh=0,kp=1,zp=2,ji=0,Vp=1,Hp=2,Gp=3,Wp=4,Xp=5,qp=6,Yp=7;var jh=300,tr=301,er=302,Al=303,Rl=304,Zo=306,Ka=1e3,gs=1001,ja=1002,kn=1003,$p=1004;var Jo=1005;var Mi=1006,Cl=1007;var Ts=1008;var Ni=1009,Qh=1010,tu=1011,Zr=1012,Pl=1013,As=1014,bi=1015,Jr=1016,Il=1017,Ll=1018,Kr=1020,eu=35902,nu=35899,iu=1021,su=1022,li=1023,Vr=1026,jr=1027,Dl=1028,Nl=1029,ru=1030,Ul=1031;var Fl=1033,Ko=33776,jo=33777,Qo=33778,ta=33779,Ol=35840,Bl=35841,kl=35842,zl=35843,Vl=36196,Hl=37492,Gl=37496,Wl=37808,Xl=37809,ql=37810,Yl=37811,$l=37812,Zl=37813,Jl=37814,Kl=37815,jl=37816,Ql=37817,tc=37818,ec=37819,nc=37820,ic=37821,sc=36492,rc=36494,oc=36495,ac=36283,lc=36284,cc=36285,hc=36286;var Po=2300,Qa=2301,$a=2302,Vh=2400,Hh=2401,Gh=2402;var Zp=3200,Jp=3201;var Kp=0,jp=1,Qi="",Nn="srgb",$s="srgb-linear",Io="linear",Ee="srgb";var Xs=7680;var Wh=519,Qp=512,tm=513,em=514,ou=515,nm=516,im=517,sm=518,rm=519,tl=35044,ts=35048;var au="300 es",vi=2e3,Lo=2001;var Pi=class{addEventListener(t,e){this._listeners===void 0&&(this._listeners={});let n=this._listeners;n[t]===void 0&&(n[t]=[]),n[t].indexOf(e)===-1&&n[t].push(e)}hasEventListener(t,e){let n=this._listeners;return n===void 0?!1:n[t]!==void 0&&n[t].indexOf(e)!==-1}removeEventListener(t,e){let n=this._listeners;if(n===void 0)return;let s=n[t];if(s!==void 0){let r=s.indexOf(e);r!==-1&&s.splice(r,1)}}dispatchEvent(t){let e=this._listeners;if(e===void 0)return;let n=e[t.type];if(n!==void 0){t.target=this;let s=n.slice(0);for(let r=0,o=s.length;r<o;r++)s[r].call(this,t);t.target=null}}},bn=["00","01","02","03","04","05","06","07","08","09","0a","0b","0c","0d","0e","0f","10","11","12","13","14","15","16","17","18","19","1a","1b","1c","1d","1e","1f","20","21","22","23","24","25","26","27","28","29","2a","2b","2c","2d","2e","2f","30","31","32","33","34","35","36","37","38","39","3a","3b","3c","3d","3e","3f","40","41","42","43","44","45","46","47","48","49","4a","4b","4c","4d","4e","4f","50","51","52","53","54","55","56","57","58","59","5a","5b","5c","5d","5e","5f","60","61","62","63","64","65","66","67","68","69","6a","6b","6c","6d","6e","6f","70","71","72","73","74","75","76","77","78","79","7a","7b","7c","7d","7e","7f","80","81","82","83","84","85","86","87","88","89","8a","8b","8c","8d","8e","8f","90","91","92","93","94","95","96","97","98","99","9a","9b","9c","9d","9e","9f","a0","a1","a2","a3","a4","a5","a6","a7","a8","a9","aa","ab","ac","ad","ae","af","b0","b1","b2","b3","b4","b5","b6","b7","b8","b9","ba","bb","bc","bd","be","bf","c0","c1","c2","c3","c4","c5","c6","c7","c8","c9","ca","cb","cc","cd","ce","cf","d0","d1","d2","d3","d4","d5","d6","d7","d8","d9","da","db","dc","dd","de","df","e0","e1","e2","e3","e4","e5","e6","e7","e8","e9","ea","eb","ec","ed","ee","ef","f0","f1","f2","f3","f4","f5","f6","f7","f8","f9","fa","fb","fc","fd","fe","ff"],jf=1234567,Ro=Math.PI/180,Hr=180/Math.PI;function Yi(){let i=Math.random()*4294967295|0,t=Math.random()*4294967295|0,e=Math.random()*4294967295|0,n=Math.random()*4294967295|0;return(bn[i&255]+bn[i>>8&255]+bn[i>>16&255]+bn[i>>24&255]+"-"+bn[t&255]+bn[t>>8&255]+"-"+bn[t>>16&15|64]+bn[t>>24&255]+"-"+bn[e&63|128]+bn[e>>8&255]+"-"+bn[e>>16&255]+bn[e>>24&255]+bn[n&255]+bn[n>>8&255]+bn[n>>16&255]+bn[n>>24&255]).toLowerCase()}function le(i,t,e){return Math.max(t,Math.min(e,i))}function lu(i,t){return(i%t+t)%t}function Y_(i,t,e,n,s){return n+(i-t)*(s-n)/(e-t)}function $_(i,t,e){return i!==t?(e-i)/(t-i):0}function Co(i,t,e){return(1-e)*i+e*t}function Z_(i,t,e,n){return Co(i,t,1-Math.exp(-e*n))}function J_(i,t=1){return t-Math.abs(lu(i,t*2)-t)}function K_(i,t,e){return i<=t?0:i>=e?1:(i=(i-t)/(e-t),i*i*(3-2*i))}function j_(i,t,e){return i<=t?0:i>=e?1:(i=(i-t)/(e-t),i*i*i*(i*(i*6-15)+10))}function Q_(i,t){return i+Math.floor(Math.random()*(t-i+1))}function tx(i,t){return i+Math.random()*(t-i)}function ex(i){return i*(.5-Math.random())}function nx(i){i!==void 0&&(jf=i);let t=jf+=1831565813;return t=Math.imul(t^t>>>15,t|1),t^=t+Math.imul(t^t>>>7,t|61),((t^t>>>14)>>>0)/4294967296}function ix(i){return i*Ro}function sx(i){return i*Hr}function rx(i){return(i&i-1)===0&&i!==0}function ox(i){return Math.pow(2,Math.ceil(Math.log(i)/Math.LN2))}function ax(i){return Math.pow(2,Math.floor(Math.log(i)/Math.LN2))}function lx(i,t,e,n,s){let r=Math.cos,o=Math.sin,a=r(e/2),c=o(e/2),l=r((t+n)/2),h=o((t+n)/2),u=r((t-n)/2),d=o((t-n)/2),f=r((n-t)/2),g=o((n-t)/2);switch(s){case"XYX":i.set(a*h,c*u,c*d,a*l);break;case"YZY":i.set(c*d,a*h,c*u,a*l);break;case"ZXZ":i.set(c*u,c*d,a*h,a*l);break;case"XZX":i.set(a*h,c*g,c*f,a*l);break;case"YXY":i.set(c*f,a*h,c*g,a*l);break;case"ZYZ":i.set(c*g,c*f,a*h,a*l);break;default:console.warn("THREE.MathUtils: .setQuaternionFromProperEuler() encountered an unknown order: "+s)}}function yi(i,t){switch(t.constructor){case Float32Array:return i;case Uint32Array:return i/4294967295;case Uint16Array:return i/65535;case Uint8Array:return i/255;case Int32Array:return Math.max(i/2147483647,-1);case Int16Array:return Math.max(i/32767,-1);case Int8Array:return Math.max(i/127,-1);default:throw new Error("Invalid component type.")}}function we(i,t){switch(t.constructor){case Float32Array:return i;case Uint32Array:return Math.round(i*4294967295);case Uint16Array:return Math.round(i*65535);case Uint8Array:return Math.round(i*255);case Int32Array:return Math.round(i*2147483647);case Int16Array:return Math.round(i*32767);case Int8Array:return Math.round(i*127);default:throw new Error("Invalid component type.")}}var cu={DEG2RAD:Ro,RAD2DEG:Hr,generateUUID:Yi,clamp:le,euclideanModulo:lu,mapLinear:Y_,inverseLerp:$_,lerp:Co,damp:Z_,pingpong:J_,smoothstep:K_,smootherstep:j_,randInt:Q_,randFloat:tx,randFloatSpread:ex,seededRandom:nx,degToRad:ix,radToDeg:sx,isPowerOfTwo:rx,ceilPowerOfTwo:ox,floorPowerOfTwo:ax,setQuaternionFromProperEuler:lx,normalize:we,denormalize:yi},Jt=class i{constructor(t=0,e=0){i.prototype.isVector2=!0,this.x=t,this.y=e}get width(){return this.x}set width(t){this.x=t}get height(){return this.y}set height(t){this.y=t}set(t,e){return this.x=t,this.y=e,this}setScalar(t){return this.x=t,this.y=t,this}setX(t){return this.x=t,this}setY(t){return this.y=t,this}setComponent(t,e){switch(t){case 0:this.x=e;break;case 1:this.y=e;break;default:throw new Error("index is out of range: "+t)}return this}getComponent(t){switch(t){case 0:return this.x;case 1:return this.y;default:throw new Error("index is out of range: "+t)}}clone(){return new this.constructor(this.x,this.y)}copy(t){return this.x=t.x,this.y=t.y,this}add(t){return this.x+=t.x,this.y+=t.y,this}addScalar(t){return this.x+=t,this.y+=t,this}addVectors(t,e){return this.x=t.x+e.x,this.y=t.y+e.y,this}addScaledVector(t,e){return this.x+=t.x*e,this.y+=t.y*e,this}sub(t){return this.x-=t.x,this.y-=t.y,this}subScalar(t){return this.x-=t,this.y-=t,this}subVectors(t,e){return this.x=t.x-e.x,this.y=t.y-e.y,this}multiply(t){return this.x*=t.x,this.y*=t.y,this}multiplyScalar(t){return this.x*=t,this.y*=t,this}divide(t){return this.x/=t.x,this.y/=t.y,this}divideScalar(t){return this.multiplyScalar(1/t)}applyMatrix3(t){let e=this.x,n=this.y,s=t.elements;return this.x=s[0]*e+s[3]*n+s[6],this.y=s[1]*e+s[4]*n+s[7],this}min(t){return this.x=Math.min(this.x,t.x),this.y=Math.min(this.y,t.y),this}max(t){return this.x=Math.max(this.x,t.x),this.y=Math.max(this.y,t.y),this}clamp(t,e){return this.x=le(this.x,t.x,e.x),this.y=le(this.y,t.y,e.y),this}clampScalar(t,e){return this.x=le(this.x,t,e),this.y=le(this.y,t,e),this}clampLength(t,e){let n=this.length();return this.divideScalar(n||1).multiplyScalar(le(n,t,e))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this}negate(){return this.x=-this.x,this.y=-this.y,this}dot(t){return this.x*t.x+this.y*t.y}cross(t){return this.x*t.y-this.y*t.x}lengthSq(){return this.x*this.x+this.y*this.y}length(){return Math.sqrt(this.x*this.x+this.y*this.y)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)}normalize(){return this.divideScalar(this.length()||1)}angle(){return Math.atan2(-this.y,-this.x)+Math.PI}angleTo(t){let e=Math.sqrt(this.lengthSq()*t.lengthSq());if(e===0)return Math.PI/2;let n=this.dot(t)/e;return Math.acos(le(n,-1,1))}distanceTo(t){return Math.sqrt(this.distanceToSquared(t))}distanceToSquared(t){let e=this.x-t.x,n=this.y-t.y;return e*e+n*n}manhattanDistanceTo(t){return Math.abs(this.x-t.x)+Math.abs(this.y-t.y)}setLength(t){return this.normalize().multiplyScalar(t)}lerp(t,e){return this.x+=(t.x-this.x)*e,this.y+=(t.y-this.y)*e,this}lerpVectors(t,e,n){return this.x=t.x+(e.x-t.x)*n,this.y=t.y+(e.y-t.y)*n,this}equals(t){return t.x===this.x&&t.y===this.y}fromArray(t,e=0){return this.x=t[e],this.y=t[e+1],this}toArray(t=[],e=0){return t[e]=this.x,t[e+1]=this.y,t}fromBufferAttribute(t,e){return this.x=t.getX(e),this.y=t.getY(e),this}rotateAround(t,e){let n=Math.cos(e),s=Math.sin(e),r=this.x-t.x,o=this.y-t.y;return this.x=r*n-o*s+t.x,this.y=r*s+o*n+t.y,this}random(){return this.x=Math.random(),this.y=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y}},Un=class{constructor(t=0,e=0,n=0,s=1){this.isQuaternion=!0,this._x=t,this._y=e,this._z=n,this._w=s}static slerpFlat(t,e,n,s,r,o,a){let c=n[s+0],l=n[s+1],h=n[s+2],u=n[s+3],d=r[o+0],f=r[o+1],g=r[o+2],x=r[o+3];if(a===0){t[e+0]=c,t[e+1]=l,t[e+2]=h,t[e+3]=u;return}if(a===1){t[e+0]=d,t[e+1]=f,t[e+2]=g,t[e+3]=x;return}if(u!==x||c!==d||l!==f||h!==g){let m=1-a,p=c*d+l*f+h*g+u*x,w=p>=0?1:-1,E=1-p*p;if(E>Number.EPSILON){let C=Math.sqrt(E),A=Math.atan2(C,p*w);m=Math.sin(m*A)/C,a=Math.sin(a*A)/C}let v=a*w;if(c=c*m+d*v,l=l*m+f*v,h=h*m+g*v,u=u*m+x*v,m===1-a){let C=1/Math.sqrt(c*c+l*l+h*h+u*u);c*=C,l*=C,h*=C,u*=C}}t[e]=c,t[e+1]=l,t[e+2]=h,t[e+3]=u}static multiplyQuaternionsFlat(t,e,n,s,r,o){let a=n[s],c=n[s+1],l=n[s+2],h=n[s+3],u=r[o],d=r[o+1],f=r[o+2],g=r[o+3];return t[e]=a*g+h*u+c*f-l*d,t[e+1]=c*g+h*d+l*u-a*f,t[e+2]=l*g+h*f+a*d-c*u,t[e+3]=h*g-a*u-c*d-l*f,t}get x(){return this._x}set x(t){this._x=t,this._onChangeCallback()}get y(){return this._y}set y(t){this._y=t,this._onChangeCallback()}get z(){return this._z}set z(t){this._z=t,this._onChangeCallback()}get w(){return this._w}set w(t){this._w=t,this._onChangeCallback()}set(t,e,n,s){return this._x=t,this._y=e,this._z=n,this._w=s,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._w)}copy(t){return this._x=t.x,this._y=t.y,this._z=t.z,this._w=t.w,this._onChangeCallback(),this}setFromEuler(t,e=!0){let n=t._x,s=t._y,r=t._z,o=t._order,a=Math.cos,c=Math.sin,l=a(n/2),h=a(s/2),u=a(r/2),d=c(n/2),f=c(s/2),g=c(r/2);switch(o){case"XYZ":this._x=d*h*u+l*f*g,this._y=l*f*u-d*h*g,this._z=l*h*g+d*f*u,this._w=l*h*u-d*f*g;break;case"YXZ":this._x=d*h*u+l*f*g,this._y=l*f*u-d*h*g,this._z=l*h*g-d*f*u,this._w=l*h*u+d*f*g;break;case"ZXY":this._x=d*h*u-l*f*g,this._y=l*f*u+d*h*g,this._z=l*h*g+d*f*u,this._w=l*h*u-d*f*g;break;case"ZYX":this._x=d*h*u-l*f*g,this._y=l*f*u+d*h*g,this._z=l*h*g-d*f*u,this._w=l*h*u+d*f*g;break;case"YZX":this._x=d*h*u+l*f*g,this._y=l*f*u+d*h*g,this._z=l*h*g-d*f*u,this._w=l*h*u-d*f*g;break;case"XZY":this._x=d*h*u-l*f*g,this._y=l*f*u-d*h*g,this._z=l*h*g+d*f*u,this._w=l*h*u+d*f*g;break;default:console.warn("THREE.Quaternion: .setFromEuler() encountered an unknown order: "+o)}return e===!0&&this._onChangeCallback(),this}setFromAxisAngle(t,e){let n=e/2,s=Math.sin(n);return this._x=t.x*s,this._y=t.y*s,this._z=t.z*s,this._w=Math.cos(n),this._onChangeCallback(),this}setFromRotationMatrix(t){let e=t.elements,n=e[0],s=e[4],r=e[8],o=e[1],a=e[5],c=e[9],l=e[2],h=e[6],u=e[10],d=n+a+u;if(d>0){let f=.5/Math.sqrt(d+1);this._w=.25/f,this._x=(h-c)*f,this._y=(r-l)*f,this._z=(o-s)*f}else if(n>a&&n>u){let f=2*Math.sqrt(1+n-a-u);this._w=(h-c)/f,this._x=.25*f,this._y=(s+o)/f,this._z=(r+l)/f}else if(a>u){let f=2*Math.sqrt(1+a-n-u);this._w=(r-l)/f,this._x=(s+o)/f,this._y=.25*f,this._z=(c+h)/f}else{let f=2*Math.sqrt(1+u-n-a);this._w=(o-s)/f,this._x=(r+l)/f,this._y=(c+h)/f,this._z=.25*f}return this._onChangeCallback(),this}setFromUnitVectors(t,e){let n=t.dot(e)+1;return n<1e-8?(n=0,Math.abs(t.x)>Math.abs(t.z)?(this._x=-t.y,this._y=t.x,this._z=0,this._w=n):(this._x=0,this._y=-t.z,this._z=t.y,this._w=n)):(this._x=t.y*e.z-t.z*e.y,this._y=t.z*e.x-t.x*e.z,this._z=t.x*e.y-t.y*e.x,this._w=n),this.normalize()}angleTo(t){return 2*Math.acos(Math.abs(le(this.dot(t),-1,1)))}rotateTowards(t,e){let n=this.angleTo(t);if(n===0)return this;let s=Math.min(1,e/n);return this.slerp(t,s),this}identity(){return this.set(0,0,0,1)}invert(){return this.conjugate()}conjugate(){return this._x*=-1,this._y*=-1,this._z*=-1,this._onChangeCallback(),this}dot(t){return this._x*t._x+this._y*t._y+this._z*t._z+this._w*t._w}lengthSq(){return this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w}length(){return Math.sqrt(this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w)}normalize(){let t=this.length();return t===0?(this._x=0,this._y=0,this._z=0,this._w=1):(t=1/t,this._x=this._x*t,this._y=this._y*t,this._z=this._z*t,this._w=this._w*t),this._onChangeCallback(),this}multiply(t){return this.multiplyQuaternions(this,t)}premultiply(t){return this.multiplyQuaternions(t,this)}multiplyQuaternions(t,e){let n=t._x,s=t._y,r=t._z,o=t._w,a=e._x,c=e._y,l=e._z,h=e._w;return this._x=n*h+o*a+s*l-r*c,this._y=s*h+o*c+r*a-n*l,this._z=r*h+o*l+n*c-s*a,this._w=o*h-n*a-s*c-r*l,this._onChangeCallback(),this}slerp(t,e){if(e===0)return this;if(e===1)return this.copy(t);let n=this._x,s=this._y,r=this._z,o=this._w,a=o*t._w+n*t._x+s*t._y+r*t._z;if(a<0?(this._w=-t._w,this._x=-t._x,this._y=-t._y,this._z=-t._z,a=-a):this.copy(t),a>=1)return this._w=o,this._x=n,this._y=s,this._z=r,this;let c=1-a*a;if(c<=Number.EPSILON){let f=1-e;return this._w=f*o+e*this._w,this._x=f*n+e*this._x,this._y=f*s+e*this._y,this._z=f*r+e*this._z,this.normalize(),this}let l=Math.sqrt(c),h=Math.atan2(l,a),u=Math.sin((1-e)*h)/l,d=Math.sin(e*h)/l;return this._w=o*u+this._w*d,this._x=n*u+this._x*d,this._y=s*u+this._y*d,this._z=r*u+this._z*d,this._onChangeCallback(),this}slerpQuaternions(t,e,n){return this.copy(t).slerp(e,n)}random(){let t=2*Math.PI*Math.random(),e=2*Math.PI*Math.random(),n=Math.random(),s=Math.sqrt(1-n),r=Math.sqrt(n);return this.set(s*Math.sin(t),s*Math.cos(t),r*Math.sin(e),r*Math.cos(e))}equals(t){return t._x===this._x&&t._y===this._y&&t._z===this._z&&t._w===this._w}fromArray(t,e=0){return this._x=t[e],this._y=t[e+1],this._z=t[e+2],this._w=t[e+3],this._onChangeCallback(),this}toArray(t=[],e=0){return t[e]=this._x,t[e+1]=this._y,t[e+2]=this._z,t[e+3]=this._w,t}fromBufferAttribute(t,e){return this._x=t.getX(e),this._y=t.getY(e),this._z=t.getZ(e),this._w=t.getW(e),this._onChangeCallback(),this}toJSON(){return this.toArray()}_onChange(t){return this._onChangeCallback=t,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._w}},H=class i{constructor(t=0,e=0,n=0){i.prototype.isVector3=!0,this.x=t,this.y=e,this.z=n}set(t,e,n){return n===void 0&&(n=this.z),this.x=t,this.y=e,this.z=n,this}setScalar(t){return this.x=t,this.y=t,this.z=t,this}setX(t){return this.x=t,this}setY(t){return this.y=t,this}setZ(t){return this.z=t,this}setComponent(t,e){switch(t){case 0:this.x=e;break;case 1:this.y=e;break;case 2:this.z=e;break;default:throw new Error("index is out of range: "+t)}return this}getComponent(t){switch(t){case 0:return this.x;case 1:return this.y;case 2:return this.z;default:throw new Error("index is out of range: "+t)}}clone(){return new this.constructor(this.x,this.y,this.z)}copy(t){return this.x=t.x,this.y=t.y,this.z=t.z,this}add(t){return this.x+=t.x,this.y+=t.y,this.z+=t.z,this}addScalar(t){return this.x+=t,this.y+=t,this.z+=t,this}addVectors(t,e){return this.x=t.x+e.x,this.y=t.y+e.y,this.z=t.z+e.z,this}addScaledVector(t,e){return this.x+=t.x*e,this.y+=t.y*e,this.z+=t.z*e,this}sub(t){return this.x-=t.x,this.y-=t.y,this.z-=t.z,this}subScalar(t){return this.x-=t,this.y-=t,this.z-=t,this}subVectors(t,e){return this.x=t.x-e.x,this.y=t.y-e.y,this.z=t.z-e.z,this}multiply(t){return this.x*=t.x,this.y*=t.y,this.z*=t.z,this}multiplyScalar(t){return this.x*=t,this.y*=t,this.z*=t,this}multiplyVectors(t,e){return this.x=t.x*e.x,this.y=t.y*e.y,this.z=t.z*e.z,this}applyEuler(t){return this.applyQuaternion(Qf.setFromEuler(t))}applyAxisAngle(t,e){return this.applyQuaternion(Qf.setFromAxisAngle(t,e))}applyMatrix3(t){let e=this.x,n=this.y,s=this.z,r=t.elements;return this.x=r[0]*e+r[3]*n+r[6]*s,this.y=r[1]*e+r[4]*n+r[7]*s,this.z=r[2]*e+r[5]*n+r[8]*s,this}applyNormalMatrix(t){return this.applyMatrix3(t).normalize()}applyMatrix4(t){let e=this.x,n=this.y,s=this.z,r=t.elements,o=1/(r[3]*e+r[7]*n+r[11]*s+r[15]);return this.x=(r[0]*e+r[4]*n+r[8]*s+r[12])*o,this.y=(r[1]*e+r[5]*n+r[9]*s+r[13])*o,this.z=(r[2]*e+r[6]*n+r[10]*s+r[14])*o,this}applyQuaternion(t){let e=this.x,n=this.y,s=this.z,r=t.x,o=t.y,a=t.z,c=t.w,l=2*(o*s-a*n),h=2*(a*e-r*s),u=2*(r*n-o*e);return this.x=e+c*l+o*u-a*h,this.y=n+c*h+a*l-r*u,this.z=s+c*u+r*h-o*l,this}project(t){return this.applyMatrix4(t.matrixWorldInverse).applyMatrix4(t.projectionMatrix)}unproject(t){return this.applyMatrix4(t.projectionMatrixInverse).applyMatrix4(t.matrixWorld)}transformDirection(t){let e=this.x,n=this.y,s=this.z,r=t.elements;return this.x=r[0]*e+r[4]*n+r[8]*s,this.y=r[1]*e+r[5]*n+r[9]*s,this.z=r[2]*e+r[6]*n+r[10]*s,this.normalize()}divide(t){return this.x/=t.x,this.y/=t.y,this.z/=t.z,this}divideScalar(t){return this.multiplyScalar(1/t)}min(t){return this.x=Math.min(this.x,t.x),this.y=Math.min(this.y,t.y),this.z=Math.min(this.z,t.z),this}max(t){return this.x=Math.max(this.x,t.x),this.y=Math.max(this.y,t.y),this.z=Math.max(this.z,t.z),this}clamp(t,e){return this.x=le(this.x,t.x,e.x),this.y=le(this.y,t.y,e.y),this.z=le(this.z,t.z,e.z),this}clampScalar(t,e){return this.x=le(this.x,t,e),this.y=le(this.y,t,e),this.z=le(this.z,t,e),this}clampLength(t,e){let n=this.length();return this.divideScalar(n||1).multiplyScalar(le(n,t,e))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this}dot(t){return this.x*t.x+this.y*t.y+this.z*t.z}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)}normalize(){return this.divideScalar(this.length()||1)}setLength(t){return this.normalize().multiplyScalar(t)}lerp(t,e){return this.x+=(t.x-this.x)*e,this.y+=(t.y-this.y)*e,this.z+=(t.z-this.z)*e,this}lerpVectors(t,e,n){return this.x=t.x+(e.x-t.x)*n,this.y=t.y+(e.y-t.y)*n,this.z=t.z+(e.z-t.z)*n,this}cross(t){return this.crossVectors(this,t)}crossVectors(t,e){let n=t.x,s=t.y,r=t.z,o=e.x,a=e.y,c=e.z;return this.x=s*c-r*a,this.y=r*o-n*c,this.z=n*a-s*o,this}projectOnVector(t){let e=t.lengthSq();if(e===0)return this.set(0,0,0);let n=t.dot(this)/e;return this.copy(t).multiplyScalar(n)}projectOnPlane(t){return vh.copy(this).projectOnVector(t),this.sub(vh)}reflect(t){return this.sub(vh.copy(t).multiplyScalar(2*this.dot(t)))}angleTo(t){let e=Math.sqrt(this.lengthSq()*t.lengthSq());if(e===0)return Math.PI/2;let n=this.dot(t)/e;return Math.acos(le(n,-1,1))}distanceTo(t){return Math.sqrt(this.distanceToSquared(t))}distanceToSquared(t){let e=this.x-t.x,n=this.y-t.y,s=this.z-t.z;return e*e+n*n+s*s}manhattanDistanceTo(t){return Math.abs(this.x-t.x)+Math.abs(this.y-t.y)+Math.abs(this.z-t.z)}setFromSpherical(t){return this.setFromSphericalCoords(t.radius,t.phi,t.theta)}setFromSphericalCoords(t,e,n){let s=Math.sin(e)*t;return this.x=s*Math.sin(n),this.y=Math.cos(e)*t,this.z=s*Math.cos(n),this}setFromCylindrical(t){return this.setFromCylindricalCoords(t.radius,t.theta,t.y)}setFromCylindricalCoords(t,e,n){return this.x=t*Math.sin(e),this.y=n,this.z=t*Math.cos(e),this}setFromMatrixPosition(t){let e=t.elements;return this.x=e[12],this.y=e[13],this.z=e[14],this}setFromMatrixScale(t){let e=this.setFromMatrixColumn(t,0).length(),n=this.setFromMatrixColumn(t,1).length(),s=this.setFromMatrixColumn(t,2).length();return this.x=e,this.y=n,this.z=s,this}setFromMatrixColumn(t,e){return this.fromArray(t.elements,e*4)}setFromMatrix3Column(t,e){return this.fromArray(t.elements,e*3)}setFromEuler(t){return this.x=t._x,this.y=t._y,this.z=t._z,this}setFromColor(t){return this.x=t.r,this.y=t.g,this.z=t.b,this}equals(t){return t.x===this.x&&t.y===this.y&&t.z===this.z}fromArray(t,e=0){return this.x=t[e],this.y=t[e+1],this.z=t[e+2],this}toArray(t=[],e=0){return t[e]=this.x,t[e+1]=this.y,t[e+2]=this.z,t}fromBufferAttribute(t,e){return this.x=t.getX(e),this.y=t.getY(e),this.z=t.getZ(e),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this}randomDirection(){let t=Math.random()*Math.PI*2,e=Math.random()*2-1,n=Math.sqrt(1-e*e);return this.x=n*Math.cos(t),this.y=e,this.z=n*Math.sin(t),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z}},vh=new H,Qf=new Un,re=class i{constructor(t,e,n,s,r,o,a,c,l){i.prototype.isMatrix3=!0,this.elements=[1,0,0,0,1,0,0,0,1],t!==void 0&&this.set(t,e,n,s,r,o,a,c,l)}set(t,e,n,s,r,o,a,c,l){let h=this.elements;return h[0]=t,h[1]=s,h[2]=a,h[3]=e,h[4]=r,h[5]=c,h[6]=n,h[7]=o,h[8]=l,this}identity(){return this.set(1,0,0,0,1,0,0,0,1),this}copy(t){let e=this.elements,n=t.elements;return e[0]=n[0],e[1]=n[1],e[2]=n[2],e[3]=n[3],e[4]=n[4],e[5]=n[5],e[6]=n[6],e[7]=n[7],e[8]=n[8],this}extractBasis(t,e,n){return t.setFromMatrix3Column(this,0),e.setFromMatrix3Column(this,1),n.setFromMatrix3Column(this,2),this}setFromMatrix4(t){let e=t.elements;return this.set(e[0],e[4],e[8],e[1],e[5],e[9],e[2],e[6],e[10]),this}multiply(t){return this.multiplyMatrices(this,t)}premultiply(t){return this.multiplyMatrices(t,this)}multiplyMatrices(t,e){let n=t.elements,s=e.elements,r=this.elements,o=n[0],a=n[3],c=n[6],l=n[1],h=n[4],u=n[7],d=n[2],f=n[5],g=n[8],x=s[0],m=s[3],p=s[6],w=s[1],E=s[4],v=s[7],C=s[2],A=s[5],D=s[8];return r[0]=o*x+a*w+c*C,r[3]=o*m+a*E+c*A,r[6]=o*p+a*v+c*D,r[1]=l*x+h*w+u*C,r[4]=l*m+h*E+u*A,r[7]=l*p+h*v+u*D,r[2]=d*x+f*w+g*C,r[5]=d*m+f*E+g*A,r[8]=d*p+f*v+g*D,this}multiplyScalar(t){let e=this.elements;return e[0]*=t,e[3]*=t,e[6]*=t,e[1]*=t,e[4]*=t,e[7]*=t,e[2]*=t,e[5]*=t,e[8]*=t,this}determinant(){let t=this.elements,e=t[0],n=t[1],s=t[2],r=t[3],o=t[4],a=t[5],c=t[6],l=t[7],h=t[8];return e*o*h-e*a*l-n*r*h+n*a*c+s*r*l-s*o*c}invert(){let t=this.elements,e=t[0],n=t[1],s=t[2],r=t[3],o=t[4],a=t[5],c=t[6],l=t[7],h=t[8],u=h*o-a*l,d=a*c-h*r,f=l*r-o*c,g=e*u+n*d+s*f;if(g===0)return this.set(0,0,0,0,0,0,0,0,0);let x=1/g;return t[0]=u*x,t[1]=(s*l-h*n)*x,t[2]=(a*n-s*o)*x,t[3]=d*x,t[4]=(h*e-s*c)*x,t[5]=(s*r-a*e)*x,t[6]=f*x,t[7]=(n*c-l*e)*x,t[8]=(o*e-n*r)*x,this}transpose(){let t,e=this.elements;return t=e[1],e[1]=e[3],e[3]=t,t=e[2],e[2]=e[6],e[6]=t,t=e[5],e[5]=e[7],e[7]=t,this}getNormalMatrix(t){return this.setFromMatrix4(t).invert().transpose()}transposeIntoArray(t){let e=this.elements;return t[0]=e[0],t[1]=e[3],t[2]=e[6],t[3]=e[1],t[4]=e[4],t[5]=e[7],t[6]=e[2],t[7]=e[5],t[8]=e[8],this}setUvTransform(t,e,n,s,r,o,a){let c=Math.cos(r),l=Math.sin(r);return this.set(n*c,n*l,-n*(c*o+l*a)+o+t,-s*l,s*c,-s*(-l*o+c*a)+a+e,0,0,1),this}scale(t,e){return this.premultiply(Mh.makeScale(t,e)),this}rotate(t){return this.premultiply(Mh.makeRotation(-t)),this}translate(t,e){return this.premultiply(Mh.makeTranslation(t,e)),this}makeTranslation(t,e){return t.isVector2?this.set(1,0,t.x,0,1,t.y,0,0,1):this.set(1,0,t,0,1,e,0,0,1),this}makeRotation(t){let e=Math.cos(t),n=Math.sin(t);return this.set(e,-n,0,n,e,0,0,0,1),this}makeScale(t,e){return this.set(t,0,0,0,e,0,0,0,1),this}equals(t){let e=this.elements,n=t.elements;for(let s=0;s<9;s++)if(e[s]!==n[s])return!1;return!0}fromArray(t,e=0){for(let n=0;n<9;n++)this.elements[n]=t[n+e];return this}toArray(t=[],e=0){let n=this.elements;return t[e]=n[0],t[e+1]=n[1],t[e+2]=n[2],t[e+3]=n[3],t[e+4]=n[4],t[e+5]=n[5],t[e+6]=n[6],t[e+7]=n[7],t[e+8]=n[8],t}clone(){return new this.constructor().fromArray(this.elements)}},Mh=new re;function hu(i){for(let t=i.length-1;t>=0;--t)if(i[t]>=65535)return!0;return!1}function Do(i){return document.createElementNS("http://www.w3.org/1999/xhtml",i)}function om(){let i=Do("canvas");return i.style.display="block",i}var tp={};function Gr(i){i in tp||(tp[i]=!0,console.warn(i))}function am(i,t,e){return new Promise(function(n,s){function r(){switch(i.clientWaitSync(t,i.SYNC_FLUSH_COMMANDS_BIT,0)){case i.WAIT_FAILED:s();break;case i.TIMEOUT_EXPIRED:setTimeout(r,e);break;default:n()}}setTimeout(r,e)})}var ep=new re().set(.4123908,.3575843,.1804808,.212639,.7151687,.0721923,.0193308,.1191948,.9505322),np=new re().set(3.2409699,-1.5373832,-.4986108,-.9692436,1.8759675,.0415551,.0556301,-.203977,1.0569715);function cx(){let i={enabled:!0,workingColorSpace:$s,spaces:{},convert:function(s,r,o){return this.enabled===!1||r===o||!r||!o||(this.spaces[r].transfer===Ee&&(s.r=$i(s.r),s.g=$i(s.g),s.b=$i(s.b)),this.spaces[r].primaries!==this.spaces[o].primaries&&(s.applyMatrix3(this.spaces[r].toXYZ),s.applyMatrix3(this.spaces[o].fromXYZ)),this.spaces[o].transfer===Ee&&(s.r=zr(s.r),s.g=zr(s.g),s.b=zr(s.b))),s},workingToColorSpace:function(s,r){return this.convert(s,this.workingColorSpace,r)},colorSpaceToWorking:function(s,r){return this.convert(s,r,this.workingColorSpace)},getPrimaries:function(s){return this.spaces[s].primaries},getTransfer:function(s){return s===Qi?Io:this.spaces[s].transfer},getToneMappingMode:function(s){return this.spaces[s].outputColorSpaceConfig.toneMappingMode||"standard"},getLuminanceCoefficients:function(s,r=this.workingColorSpace){return s.fromArray(this.spaces[r].luminanceCoefficients)},define:function(s){Object.assign(this.spaces,s)},_getMatrix:function(s,r,o){return s.copy(this.spaces[r].toXYZ).multiply(this.spaces[o].fromXYZ)},_getDrawingBufferColorSpace:function(s){return this.spaces[s].outputColorSpaceConfig.drawingBufferColorSpace},_getUnpackColorSpace:function(s=this.workingColorSpace){return this.spaces[s].workingColorSpaceConfig.unpackColorSpace},fromWorkingColorSpace:function(s,r){return Gr("THREE.ColorManagement: .fromWorkingColorSpace() has been renamed to .workingToColorSpace()."),i.workingToColorSpace(s,r)},toWorkingColorSpace:function(s,r){return Gr("THREE.ColorManagement: .toWorkingColorSpace() has been renamed to .colorSpaceToWorking()."),i.colorSpaceToWorking(s,r)}},t=[.64,.33,.3,.6,.15,.06],e=[.2126,.7152,.0722],n=[.3127,.329];return i.define({[$s]:{primaries:t,whitePoint:n,transfer:Io,toXYZ:ep,fromXYZ:np,luminanceCoefficients:e,workingColorSpaceConfig:{unpackColorSpace:Nn},outputColorSpaceConfig:{drawingBufferColorSpace:Nn}},[Nn]:{primaries:t,whitePoint:n,transfer:Ee,toXYZ:ep,fromXYZ:np,luminanceCoefficients:e,outputColorSpaceConfig:{drawingBufferColorSpace:Nn}}}),i}var fe=cx();function $i(i){return i<.04045?i*.0773993808:Math.pow(i*.9478672986+.0521327014,2.4)}function zr(i){return i<.0031308?i*12.92:1.055*Math.pow(i,.41666)-.055}var Ar,el=class{static getDataURL(t,e="image/png"){if(/^data:/i.test(t.src)||typeof HTMLCanvasElement>"u")return t.src;let n;if(t instanceof HTMLCanvasElement)n=t;else{Ar===void 0&&(Ar=Do("canvas")),Ar.width=t.width,Ar.height=t.height;let s=Ar.getContext("2d");t instanceof ImageData?s.putImageData(t,0,0):s.drawImage(t,0,0,t.width,t.height),n=Ar}return n.toDataURL(e)}static sRGBToLinear(t){if(typeof HTMLImageElement<"u"&&t instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&t instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&t instanceof ImageBitmap){let e=Do("canvas");e.width=t.width,e.height=t.height;let n=e.getContext("2d");n.drawImage(t,0,0,t.width,t.height);let s=n.getImageData(0,0,t.width,t.height),r=s.data;for(let o=0;o<r.length;o++)r[o]=$i(r[o]/255)*255;return n.putImageData(s,0,0),e}else if(t.data){let e=t.data.slice(0);for(let n=0;n<e.length;n++)e instanceof Uint8Array||e instanceof Uint8ClampedArray?e[n]=Math.floor($i(e[n]/255)*255):e[n]=$i(e[n]);return{data:e,width:t.width,height:t.height}}else return console.warn("THREE.ImageUtils.sRGBToLinear(): Unsupported image type. No color space conversion applied."),t}},hx=0,Wr=class{constructor(t=null){this.isSource=!0,Object.defineProperty(this,"id",{value:hx++}),this.uuid=Yi(),this.data=t,this.dataReady=!0,this.version=0}getSize(t){let e=this.data;return typeof HTMLVideoElement<"u"&&e instanceof HTMLVideoElement?t.set(e.videoWidth,e.videoHeight,0):e instanceof VideoFrame?t.set(e.displayHeight,e.displayWidth,0):e!==null?t.set(e.width,e.height,e.depth||0):t.set(0,0,0),t}set needsUpdate(t){t===!0&&this.version++}toJSON(t){let e=t===void 0||typeof t=="string";if(!e&&t.images[this.uuid]!==void 0)return t.images[this.uuid];let n={uuid:this.uuid,url:""},s=this.data;if(s!==null){let r;if(Array.isArray(s)){r=[];for(let o=0,a=s.length;o<a;o++)s[o].isDataTexture?r.push(bh(s[o].image)):r.push(bh(s[o]))}else r=bh(s);n.url=r}return e||(t.images[this.uuid]=n),n}};function bh(i){return typeof HTMLImageElement<"u"&&i instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&i instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&i instanceof ImageBitmap?el.getDataURL(i):i.data?{data:Array.from(i.data),width:i.width,height:i.height,type:i.data.constructor.name}:(console.warn("THREE.Texture: Unable to serialize Texture."),{})}var ux=0,Sh=new H,zn=class i extends Pi{constructor(t=i.DEFAULT_IMAGE,e=i.DEFAULT_MAPPING,n=gs,s=gs,r=Mi,o=Ts,a=li,c=Ni,l=i.DEFAULT_ANISOTROPY,h=Qi){super(),this.isTexture=!0,Object.defineProperty(this,"id",{value:ux++}),this.uuid=Yi(),this.name="",this.source=new Wr(t),this.mipmaps=[],this.mapping=e,this.channel=0,this.wrapS=n,this.wrapT=s,this.magFilter=r,this.minFilter=o,this.anisotropy=l,this.format=a,this.internalFormat=null,this.type=c,this.offset=new Jt(0,0),this.repeat=new Jt(1,1),this.center=new Jt(0,0),this.rotation=0,this.matrixAutoUpdate=!0,this.matrix=new re,this.generateMipmaps=!0,this.premultiplyAlpha=!1,this.flipY=!0,this.unpackAlignment=4,this.colorSpace=h,this.userData={},this.updateRanges=[],this.version=0,this.onUpdate=null,this.renderTarget=null,this.isRenderTargetTexture=!1,this.isArrayTexture=!!(t&&t.depth&&t.depth>1),this.pmremVersion=0}get width(){return this.source.getSize(Sh).x}get height(){return this.source.getSize(Sh).y}get depth(){return this.source.getSize(Sh).z}get image(){return this.source.data}set image(t=null){this.source.data=t}updateMatrix(){this.matrix.setUvTransform(this.offset.x,this.offset.y,this.repeat.x,this.repeat.y,this.rotation,this.center.x,this.center.y)}addUpdateRange(t,e){this.updateRanges.push({start:t,count:e})}clearUpdateRanges(){this.updateRanges.length=0}clone(){return new this.constructor().copy(this)}copy(t){return this.name=t.name,this.source=t.source,this.mipmaps=t.mipmaps.slice(0),this.mapping=t.mapping,this.channel=t.channel,this.wrapS=t.wrapS,this.wrapT=t.wrapT,this.magFilter=t.magFilter,this.minFilter=t.minFilter,this.anisotropy=t.anisotropy,this.format=t.format,this.internalFormat=t.internalFormat,this.type=t.type,this.offset.copy(t.offset),this.repeat.copy(t.repeat),this.center.copy(t.center),this.rotation=t.rotation,this.matrixAutoUpdate=t.matrixAutoUpdate,this.matrix.copy(t.matrix),this.generateMipmaps=t.generateMipmaps,this.premultiplyAlpha=t.premultiplyAlpha,this.flipY=t.flipY,this.unpackAlignment=t.unpackAlignment,this.colorSpace=t.colorSpace,this.renderTarget=t.renderTarget,this.isRenderTargetTexture=t.isRenderTargetTexture,this.isArrayTexture=t.isArrayTexture,this.userData=JSON.parse(JSON.stringify(t.userData)),this.needsUpdate=!0,this}setValues(t){for(let e in t){let n=t[e];if(n===void 0){console.warn(`THREE.Texture.setValues(): parameter '${e}' has value of undefined.`);continue}let s=this[e];if(s===void 0){console.warn(`THREE.Texture.setValues(): property '${e}' does not exist.`);continue}s&&n&&s.isVector2&&n.isVector2||s&&n&&s.isVector3&&n.isVector3||s&&n&&s.isMatrix3&&n.isMatrix3?s.copy(n):this[e]=n}}toJSON(t){let e=t===void 0||typeof t=="string";if(!e&&t.textures[this.uuid]!==void 0)return t.textures[this.uuid];let n={metadata:{version:4.7,type:"Texture",generator:"Texture.toJSON"},uuid:this.uuid,name:this.name,image:this.source.toJSON(t).uuid,mapping:this.mapping,channel:this.channel,repeat:[this.repeat.x,this.repeat.y],offset:[this.offset.x,this.offset.y],center:[this.center.x,this.center.y],rotation:this.rotation,wrap:[this.wrapS,this.wrapT],format:this.format,internalFormat:this.internalFormat,type:this.type,colorSpace:this.colorSpace,minFilter:this.minFilter,magFilter:this.magFilter,anisotropy:this.anisotropy,flipY:this.flipY,generateMipmaps:this.generateMipmaps,premultiplyAlpha:this.premultiplyAlpha,unpackAlignment:this.unpackAlignment};return Object.keys(this.userData).length>0&&(n.userData=this.userData),e||(t.textures[this.uuid]=n),n}dispose(){this.dispatchEvent({type:"dispose"})}transformUv(t){if(this.mapping!==jh)return t;if(t.applyMatrix3(this.matrix),t.x<0||t.x>1)switch(this.wrapS){case Ka:t.x=t.x-Math.floor(t.x);break;case gs:t.x=t.x<0?0:1;break;case ja:Math.abs(Math.floor(t.x)%2)===1?t.x=Math.ceil(t.x)-t.x:t.x=t.x-Math.floor(t.x);break}if(t.y<0||t.y>1)switch(this.wrapT){case Ka:t.y=t.y-Math.floor(t.y);break;case gs:t.y=t.y<0?0:1;break;case ja:Math.abs(Math.floor(t.y)%2)===1?t.y=Math.ceil(t.y)-t.y:t.y=t.y-Math.floor(t.y);break}return this.flipY&&(t.y=1-t.y),t}set needsUpdate(t){t===!0&&(this.version++,this.source.needsUpdate=!0)}set needsPMREMUpdate(t){t===!0&&this.pmremVersion++}};zn.DEFAULT_IMAGE=null;zn.DEFAULT_MAPPING=jh;zn.DEFAULT_ANISOTROPY=1;var Ze=class i{constructor(t=0,e=0,n=0,s=1){i.prototype.isVector4=!0,this.x=t,this.y=e,this.z=n,this.w=s}get width(){return this.z}set width(t){this.z=t}get height(){return this.w}set height(t){this.w=t}set(t,e,n,s){return this.x=t,this.y=e,this.z=n,this.w=s,this}setScalar(t){return this.x=t,this.y=t,this.z=t,this.w=t,this}setX(t){return this.x=t,this}setY(t){return this.y=t,this}setZ(t){return this.z=t,this}setW(t){return this.w=t,this}setComponent(t,e){switch(t){case 0:this.x=e;break;case 1:this.y=e;break;case 2:this.z=e;break;case 3:this.w=e;break;default:throw new Error("index is out of range: "+t)}return this}getComponent(t){switch(t){case 0:return this.x;case 1:return this.y;case 2:return this.z;case 3:return this.w;default:throw new Error("index is out of range: "+t)}}clone(){return new this.constructor(this.x,this.y,this.z,this.w)}copy(t){return this.x=t.x,this.y=t.y,this.z=t.z,this.w=t.w!==void 0?t.w:1,this}add(t){return this.x+=t.x,this.y+=t.y,this.z+=t.z,this.w+=t.w,this}addScalar(t){return this.x+=t,this.y+=t,this.z+=t,this.w+=t,this}addVectors(t,e){return this.x=t.x+e.x,this.y=t.y+e.y,this.z=t.z+e.z,this.w=t.w+e.w,this}addScaledVector(t,e){return this.x+=t.x*e,this.y+=t.y*e,this.z+=t.z*e,this.w+=t.w*e,this}sub(t){return this.x-=t.x,this.y-=t.y,this.z-=t.z,this.w-=t.w,this}subScalar(t){return this.x-=t,this.y-=t,this.z-=t,this.w-=t,this}subVectors(t,e){return this.x=t.x-e.x,this.y=t.y-e.y,this.z=t.z-e.z,this.w=t.w-e.w,this}multiply(t){return this.x*=t.x,this.y*=t.y,this.z*=t.z,this.w*=t.w,this}multiplyScalar(t){return this.x*=t,this.y*=t,this.z*=t,this.w*=t,this}applyMatrix4(t){let e=this.x,n=this.y,s=this.z,r=this.w,o=t.elements;return this.x=o[0]*e+o[4]*n+o[8]*s+o[12]*r,this.y=o[1]*e+o[5]*n+o[9]*s+o[13]*r,this.z=o[2]*e+o[6]*n+o[10]*s+o[14]*r,this.w=o[3]*e+o[7]*n+o[11]*s+o[15]*r,this}divide(t){return this.x/=t.x,this.y/=t.y,this.z/=t.z,this.w/=t.w,this}divideScalar(t){return this.multiplyScalar(1/t)}setAxisAngleFromQuaternion(t){this.w=2*Math.acos(t.w);let e=Math.sqrt(1-t.w*t.w);return e<1e-4?(this.x=1,this.y=0,this.z=0):(this.x=t.x/e,this.y=t.y/e,this.z=t.z/e),this}setAxisAngleFromRotationMatrix(t){let e,n,s,r,c=t.elements,l=c[0],h=c[4],u=c[8],d=c[1],f=c[5],g=c[9],x=c[2],m=c[6],p=c[10];if(Math.abs(h-d)<.01&&Math.abs(u-x)<.01&&Math.abs(g-m)<.01){if(Math.abs(h+d)<.1&&Math.abs(u+x)<.1&&Math.abs(g+m)<.1&&Math.abs(l+f+p-3)<.1)return this.set(1,0,0,0),this;e=Math.PI;let E=(l+1)/2,v=(f+1)/2,C=(p+1)/2,A=(h+d)/4,D=(u+x)/4,U=(g+m)/4;return E>v&&E>C?E<.01?(n=0,s=.707106781,r=.707106781):(n=Math.sqrt(E),s=A/n,r=D/n):v>C?v<.01?(n=.707106781,s=0,r=.707106781):(s=Math.sqrt(v),n=A/s,r=U/s):C<.01?(n=.707106781,s=.707106781,r=0):(r=Math.sqrt(C),n=D/r,s=U/r),this.set(n,s,r,e),this}let w=Math.sqrt((m-g)*(m-g)+(u-x)*(u-x)+(d-h)*(d-h));return Math.abs(w)<.001&&(w=1),this.x=(m-g)/w,this.y=(u-x)/w,this.z=(d-h)/w,this.w=Math.acos((l+f+p-1)/2),this}setFromMatrixPosition(t){let e=t.elements;return this.x=e[12],this.y=e[13],this.z=e[14],this.w=e[15],this}min(t){return this.x=Math.min(this.x,t.x),this.y=Math.min(this.y,t.y),this.z=Math.min(this.z,t.z),this.w=Math.min(this.w,t.w),this}max(t){return this.x=Math.max(this.x,t.x),this.y=Math.max(this.y,t.y),this.z=Math.max(this.z,t.z),this.w=Math.max(this.w,t.w),this}clamp(t,e){return this.x=le(this.x,t.x,e.x),this.y=le(this.y,t.y,e.y),this.z=le(this.z,t.z,e.z),this.w=le(this.w,t.w,e.w),this}clampScalar(t,e){return this.x=le(this.x,t,e),this.y=le(this.y,t,e),this.z=le(this.z,t,e),this.w=le(this.w,t,e),this}clampLength(t,e){let n=this.length();return this.divideScalar(n||1).multiplyScalar(le(n,t,e))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this.w=Math.floor(this.w),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this.w=Math.ceil(this.w),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this.w=Math.round(this.w),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this.w=Math.trunc(this.w),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this.w=-this.w,this}dot(t){return this.x*t.x+this.y*t.y+this.z*t.z+this.w*t.w}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)+Math.abs(this.w)}normalize(){return this.divideScalar(this.length()||1)}setLength(t){return this.normalize().multiplyScalar(t)}lerp(t,e){return this.x+=(t.x-this.x)*e,this.y+=(t.y-this.y)*e,this.z+=(t.z-this.z)*e,this.w+=(t.w-this.w)*e,this}lerpVectors(t,e,n){return this.x=t.x+(e.x-t.x)*n,this.y=t.y+(e.y-t.y)*n,this.z=t.z+(e.z-t.z)*n,this.w=t.w+(e.w-t.w)*n,this}equals(t){return t.x===this.x&&t.y===this.y&&t.z===this.z&&t.w===this.w}fromArray(t,e=0){return this.x=t[e],this.y=t[e+1],this.z=t[e+2],this.w=t[e+3],this}toArray(t=[],e=0){return t[e]=this.x,t[e+1]=this.y,t[e+2]=this.z,t[e+3]=this.w,t}fromBufferAttribute(t,e){return this.x=t.getX(e),this.y=t.getY(e),this.z=t.getZ(e),this.w=t.getW(e),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this.w=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z,yield this.w}},nl=class extends Pi{constructor(t=1,e=1,n={}){super(),n=Object.assign({generateMipmaps:!1,internalFormat:null,minFilter:Mi,depthBuffer:!0,stencilBuffer:!1,resolveDepthBuffer:!0,resolveStencilBuffer:!0,depthTexture:null,samples:0,count:1,depth:1,multiview:!1},n),this.isRenderTarget=!0,this.width=t,this.height=e,this.depth=n.depth,this.scissor=new Ze(0,0,t,e),this.scissorTest=!1,this.viewport=new Ze(0,0,t,e);let s={width:t,height:e,depth:n.depth},r=new zn(s);this.textures=[];let o=n.count;for(let a=0;a<o;a++)this.textures[a]=r.clone(),this.textures[a].isRenderTargetTexture=!0,this.textures[a].renderTarget=this;this._setTextureOptions(n),this.depthBuffer=n.depthBuffer,this.stencilBuffer=n.stencilBuffer,this.resolveDepthBuffer=n.resolveDepthBuffer,this.resolveStencilBuffer=n.resolveStencilBuffer,this._depthTexture=null,this.depthTexture=n.depthTexture,this.samples=n.samples,this.multiview=n.multiview}_setTextureOptions(t={}){let e={minFilter:Mi,generateMipmaps:!1,flipY:!1,internalFormat:null};t.mapping!==void 0&&(e.mapping=t.mapping),t.wrapS!==void 0&&(e.wrapS=t.wrapS),t.wrapT!==void 0&&(e.wrapT=t.wrapT),t.wrapR!==void 0&&(e.wrapR=t.wrapR),t.magFilter!==void 0&&(e.magFilter=t.magFilter),t.minFilter!==void 0&&(e.minFilter=t.minFilter),t.format!==void 0&&(e.format=t.format),t.type!==void 0&&(e.type=t.type),t.anisotropy!==void 0&&(e.anisotropy=t.anisotropy),t.colorSpace!==void 0&&(e.colorSpace=t.colorSpace),t.flipY!==void 0&&(e.flipY=t.flipY),t.generateMipmaps!==void 0&&(e.generateMipmaps=t.generateMipmaps),t.internalFormat!==void 0&&(e.internalFormat=t.internalFormat);for(let n=0;n<this.textures.length;n++)this.textures[n].setValues(e)}get texture(){return this.textures[0]}set texture(t){this.textures[0]=t}set depthTexture(t){this._depthTexture!==null&&(this._depthTexture.renderTarget=null),t!==null&&(t.renderTarget=this),this._depthTexture=t}get depthTexture(){return this._depthTexture}setSize(t,e,n=1){if(this.width!==t||this.height!==e||this.depth!==n){this.width=t,this.height=e,this.depth=n;for(let s=0,r=this.textures.length;s<r;s++)this.textures[s].image.width=t,this.textures[s].image.height=e,this.textures[s].image.depth=n,this.textures[s].isArrayTexture=this.textures[s].image.depth>1;this.dispose()}this.viewport.set(0,0,t,e),this.scissor.set(0,0,t,e)}clone(){return new this.constructor().copy(this)}copy(t){this.width=t.width,this.height=t.height,this.depth=t.depth,this.scissor.copy(t.scissor),this.scissorTest=t.scissorTest,this.viewport.copy(t.viewport),this.textures.length=0;for(let e=0,n=t.textures.length;e<n;e++){this.textures[e]=t.textures[e].clone(),this.textures[e].isRenderTargetTexture=!0,this.textures[e].renderTarget=this;let s=Object.assign({},t.textures[e].image);this.textures[e].source=new Wr(s)}return this.depthBuffer=t.depthBuffer,this.stencilBuffer=t.stencilBuffer,this.resolveDepthBuffer=t.resolveDepthBuffer,this.resolveStencilBuffer=t.resolveStencilBuffer,t.depthTexture!==null&&(this.depthTexture=t.depthTexture.clone()),this.samples=t.samples,this}dispose(){this.dispatchEvent({type:"dispose"})}},Ii=class extends nl{constructor(t=1,e=1,n={}){super(t,e,n),this.isWebGLRenderTarget=!0}},No=class extends zn{constructor(t=null,e=1,n=1,s=1){super(null),this.isDataArrayTexture=!0,this.image={data:t,width:e,height:n,depth:s},this.magFilter=kn,this.minFilter=kn,this.wrapR=gs,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1,this.layerUpdates=new Set}addLayerUpdate(t){this.layerUpdates.add(t)}clearLayerUpdates(){this.layerUpdates.clear()}};var il=class extends zn{constructor(t=null,e=1,n=1,s=1){super(null),this.isData3DTexture=!0,this.image={data:t,width:e,height:n,depth:s},this.magFilter=kn,this.minFilter=kn,this.wrapR=gs,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}};var oi=class{constructor(t=new H(1/0,1/0,1/0),e=new H(-1/0,-1/0,-1/0)){this.isBox3=!0,this.min=t,this.max=e}set(t,e){return this.min.copy(t),this.max.copy(e),this}setFromArray(t){this.makeEmpty();for(let e=0,n=t.length;e<n;e+=3)this.expandByPoint(gi.fromArray(t,e));return this}setFromBufferAttribute(t){this.makeEmpty();for(let e=0,n=t.count;e<n;e++)this.expandByPoint(gi.fromBufferAttribute(t,e));return this}setFromPoints(t){this.makeEmpty();for(let e=0,n=t.length;e<n;e++)this.expandByPoint(t[e]);return this}setFromCenterAndSize(t,e){let n=gi.copy(e).multiplyScalar(.5);return this.min.copy(t).sub(n),this.max.copy(t).add(n),this}setFromObject(t,e=!1){return this.makeEmpty(),this.expandByObject(t,e)}clone(){return new this.constructor().copy(this)}copy(t){return this.min.copy(t.min),this.max.copy(t.max),this}makeEmpty(){return this.min.x=this.min.y=this.min.z=1/0,this.max.x=this.max.y=this.max.z=-1/0,this}isEmpty(){return this.max.x<this.min.x||this.max.y<this.min.y||this.max.z<this.min.z}getCenter(t){return this.isEmpty()?t.set(0,0,0):t.addVectors(this.min,this.max).multiplyScalar(.5)}getSize(t){return this.isEmpty()?t.set(0,0,0):t.subVectors(this.max,this.min)}expandByPoint(t){return this.min.min(t),this.max.max(t),this}expandByVector(t){return this.min.sub(t),this.max.add(t),this}expandByScalar(t){return this.min.addScalar(-t),this.max.addScalar(t),this}expandByObject(t,e=!1){t.updateWorldMatrix(!1,!1);let n=t.geometry;if(n!==void 0){let r=n.getAttribute("position");if(e===!0&&r!==void 0&&t.isInstancedMesh!==!0)for(let o=0,a=r.count;o<a;o++)t.isMesh===!0?t.getVertexPosition(o,gi):gi.fromBufferAttribute(r,o),gi.applyMatrix4(t.matrixWorld),this.expandByPoint(gi);else t.boundingBox!==void 0?(t.boundingBox===null&&t.computeBoundingBox(),Ca.copy(t.boundingBox)):(n.boundingBox===null&&n.computeBoundingBox(),Ca.copy(n.boundingBox)),Ca.applyMatrix4(t.matrixWorld),this.union(Ca)}let s=t.children;for(let r=0,o=s.length;r<o;r++)this.expandByObject(s[r],e);return this}containsPoint(t){return t.x>=this.min.x&&t.x<=this.max.x&&t.y>=this.min.y&&t.y<=this.max.y&&t.z>=this.min.z&&t.z<=this.max.z}containsBox(t){return this.min.x<=t.min.x&&t.max.x<=this.max.x&&this.min.y<=t.min.y&&t.max.y<=this.max.y&&this.min.z<=t.min.z&&t.max.z<=this.max.z}getParameter(t,e){return e.set((t.x-this.min.x)/(this.max.x-this.min.x),(t.y-this.min.y)/(this.max.y-this.min.y),(t.z-this.min.z)/(this.max.z-this.min.z))}intersectsBox(t){return t.max.x>=this.min.x&&t.min.x<=this.max.x&&t.max.y>=this.min.y&&t.min.y<=this.max.y&&t.max.z>=this.min.z&&t.min.z<=this.max.z}intersectsSphere(t){return this.clampPoint(t.center,gi),gi.distanceToSquared(t.center)<=t.radius*t.radius}intersectsPlane(t){let e,n;return t.normal.x>0?(e=t.normal.x*this.min.x,n=t.normal.x*this.max.x):(e=t.normal.x*this.max.x,n=t.normal.x*this.min.x),t.normal.y>0?(e+=t.normal.y*this.min.y,n+=t.normal.y*this.max.y):(e+=t.normal.y*this.max.y,n+=t.normal.y*this.min.y),t.normal.z>0?(e+=t.normal.z*this.min.z,n+=t.normal.z*this.max.z):(e+=t.normal.z*this.max.z,n+=t.normal.z*this.min.z),e<=-t.constant&&n>=-t.constant}intersectsTriangle(t){if(this.isEmpty())return!1;this.getCenter(bo),Pa.subVectors(this.max,bo),Rr.subVectors(t.a,bo),Cr.subVectors(t.b,bo),Pr.subVectors(t.c,bo),cs.subVectors(Cr,Rr),hs.subVectors(Pr,Cr),Vs.subVectors(Rr,Pr);let e=[0,-cs.z,cs.y,0,-hs.z,hs.y,0,-Vs.z,Vs.y,cs.z,0,-cs.x,hs.z,0,-hs.x,Vs.z,0,-Vs.x,-cs.y,cs.x,0,-hs.y,hs.x,0,-Vs.y,Vs.x,0];return!wh(e,Rr,Cr,Pr,Pa)||(e=[1,0,0,0,1,0,0,0,1],!wh(e,Rr,Cr,Pr,Pa))?!1:(Ia.crossVectors(cs,hs),e=[Ia.x,Ia.y,Ia.z],wh(e,Rr,Cr,Pr,Pa))}clampPoint(t,e){return e.copy(t).clamp(this.min,this.max)}distanceToPoint(t){return this.clampPoint(t,gi).distanceTo(t)}getBoundingSphere(t){return this.isEmpty()?t.makeEmpty():(this.getCenter(t.center),t.radius=this.getSize(gi).length()*.5),t}intersect(t){return this.min.max(t.min),this.max.min(t.max),this.isEmpty()&&this.makeEmpty(),this}union(t){return this.min.min(t.min),this.max.max(t.max),this}applyMatrix4(t){return this.isEmpty()?this:(Vi[0].set(this.min.x,this.min.y,this.min.z).applyMatrix4(t),Vi[1].set(this.min.x,this.min.y,this.max.z).applyMatrix4(t),Vi[2].set(this.min.x,this.max.y,this.min.z).applyMatrix4(t),Vi[3].set(this.min.x,this.max.y,this.max.z).applyMatrix4(t),Vi[4].set(this.max.x,this.min.y,this.min.z).applyMatrix4(t),Vi[5].set(this.max.x,this.min.y,this.max.z).applyMatrix4(t),Vi[6].set(this.max.x,this.max.y,this.min.z).applyMatrix4(t),Vi[7].set(this.max.x,this.max.y,this.max.z).applyMatrix4(t),this.setFromPoints(Vi),this)}translate(t){return this.min.add(t),this.max.add(t),this}equals(t){return t.min.equals(this.min)&&t.max.equals(this.max)}toJSON(){return{min:this.min.toArray(),max:this.max.toArray()}}fromJSON(t){return this.min.fromArray(t.min),this.max.fromArray(t.max),this}},Vi=[new H,new H,new H,new H,new H,new H,new H,new H],gi=new H,Ca=new oi,Rr=new H,Cr=new H,Pr=new H,cs=new H,hs=new H,Vs=new H,bo=new H,Pa=new H,Ia=new H,Hs=new H;function wh(i,t,e,n,s){for(let r=0,o=i.length-3;r<=o;r+=3){Hs.fromArray(i,r);let a=s.x*Math.abs(Hs.x)+s.y*Math.abs(Hs.y)+s.z*Math.abs(Hs.z),c=t.dot(Hs),l=e.dot(Hs),h=n.dot(Hs);if(Math.max(-Math.max(c,l,h),Math.min(c,l,h))>a)return!1}return!0}var dx=new oi,So=new H,Eh=new H,xs=class{constructor(t=new H,e=-1){this.isSphere=!0,this.center=t,this.radius=e}set(t,e){return this.center.copy(t),this.radius=e,this}setFromPoints(t,e){let n=this.center;e!==void 0?n.copy(e):dx.setFromPoints(t).getCenter(n);let s=0;for(let r=0,o=t.length;r<o;r++)s=Math.max(s,n.distanceToSquared(t[r]));return this.radius=Math.sqrt(s),this}copy(t){return this.center.copy(t.center),this.radius=t.radius,this}isEmpty(){return this.radius<0}makeEmpty(){return this.center.set(0,0,0),this.radius=-1,this}containsPoint(t){return t.distanceToSquared(this.center)<=this.radius*this.radius}distanceToPoint(t){return t.distanceTo(this.center)-this.radius}intersectsSphere(t){let e=this.radius+t.radius;return t.center.distanceToSquared(this.center)<=e*e}intersectsBox(t){return t.intersectsSphere(this)}intersectsPlane(t){return Math.abs(t.distanceToPoint(this.center))<=this.radius}clampPoint(t,e){let n=this.center.distanceToSquared(t);return e.copy(t),n>this.radius*this.radius&&(e.sub(this.center).normalize(),e.multiplyScalar(this.radius).add(this.center)),e}getBoundingBox(t){return this.isEmpty()?(t.makeEmpty(),t):(t.set(this.center,this.center),t.expandByScalar(this.radius),t)}applyMatrix4(t){return this.center.applyMatrix4(t),this.radius=this.radius*t.getMaxScaleOnAxis(),this}translate(t){return this.center.add(t),this}expandByPoint(t){if(this.isEmpty())return this.center.copy(t),this.radius=0,this;So.subVectors(t,this.center);let e=So.lengthSq();if(e>this.radius*this.radius){let n=Math.sqrt(e),s=(n-this.radius)*.5;this.center.addScaledVector(So,s/n),this.radius+=s}return this}union(t){return t.isEmpty()?this:this.isEmpty()?(this.copy(t),this):(this.center.equals(t.center)===!0?this.radius=Math.max(this.radius,t.radius):(Eh.subVectors(t.center,this.center).setLength(t.radius),this.expandByPoint(So.copy(t.center).add(Eh)),this.expandByPoint(So.copy(t.center).sub(Eh))),this)}equals(t){return t.center.equals(this.center)&&t.radius===this.radius}clone(){return new this.constructor().copy(this)}toJSON(){return{radius:this.radius,center:this.center.toArray()}}fromJSON(t){return this.radius=t.radius,this.center.fromArray(t.center),this}},Hi=new H,Th=new H,La=new H,us=new H,Ah=new H,Da=new H,Rh=new H,Xr=class{constructor(t=new H,e=new H(0,0,-1)){this.origin=t,this.direction=e}set(t,e){return this.origin.copy(t),this.direction.copy(e),this}copy(t){return this.origin.copy(t.origin),this.direction.copy(t.direction),this}at(t,e){return e.copy(this.origin).addScaledVector(this.direction,t)}lookAt(t){return this.direction.copy(t).sub(this.origin).normalize(),this}recast(t){return this.origin.copy(this.at(t,Hi)),this}closestPointToPoint(t,e){e.subVectors(t,this.origin);let n=e.dot(this.direction);return n<0?e.copy(this.origin):e.copy(this.origin).addScaledVector(this.direction,n)}distanceToPoint(t){return Math.sqrt(this.distanceSqToPoint(t))}distanceSqToPoint(t){let e=Hi.subVectors(t,this.origin).dot(this.direction);return e<0?this.origin.distanceToSquared(t):(Hi.copy(this.origin).addScaledVector(this.direction,e),Hi.distanceToSquared(t))}distanceSqToSegment(t,e,n,s){Th.copy(t).add(e).multiplyScalar(.5),La.copy(e).sub(t).normalize(),us.copy(this.origin).sub(Th);let r=t.distanceTo(e)*.5,o=-this.direction.dot(La),a=us.dot(this.direction),c=-us.dot(La),l=us.lengthSq(),h=Math.abs(1-o*o),u,d,f,g;if(h>0)if(u=o*c-a,d=o*a-c,g=r*h,u>=0)if(d>=-g)if(d<=g){let x=1/h;u*=x,d*=x,f=u*(u+o*d+2*a)+d*(o*u+d+2*c)+l}else d=r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*c)+l;else d=-r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*c)+l;else d<=-g?(u=Math.max(0,-(-o*r+a)),d=u>0?-r:Math.min(Math.max(-r,-c),r),f=-u*u+d*(d+2*c)+l):d<=g?(u=0,d=Math.min(Math.max(-r,-c),r),f=d*(d+2*c)+l):(u=Math.max(0,-(o*r+a)),d=u>0?r:Math.min(Math.max(-r,-c),r),f=-u*u+d*(d+2*c)+l);else d=o>0?-r:r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*c)+l;return n&&n.copy(this.origin).addScaledVector(this.direction,u),s&&s.copy(Th).addScaledVector(La,d),f}intersectSphere(t,e){Hi.subVectors(t.center,this.origin);let n=Hi.dot(this.direction),s=Hi.dot(Hi)-n*n,r=t.radius*t.radius;if(s>r)return null;let o=Math.sqrt(r-s),a=n-o,c=n+o;return c<0?null:a<0?this.at(c,e):this.at(a,e)}intersectsSphere(t){return t.radius<0?!1:this.distanceSqToPoint(t.center)<=t.radius*t.radius}distanceToPlane(t){let e=t.normal.dot(this.direction);if(e===0)return t.distanceToPoint(this.origin)===0?0:null;let n=-(this.origin.dot(t.normal)+t.constant)/e;return n>=0?n:null}intersectPlane(t,e){let n=this.distanceToPlane(t);return n===null?null:this.at(n,e)}intersectsPlane(t){let e=t.distanceToPoint(this.origin);return e===0||t.normal.dot(this.direction)*e<0}intersectBox(t,e){let n,s,r,o,a,c,l=1/this.direction.x,h=1/this.direction.y,u=1/this.direction.z,d=this.origin;return l>=0?(n=(t.min.x-d.x)*l,s=(t.max.x-d.x)*l):(n=(t.max.x-d.x)*l,s=(t.min.x-d.x)*l),h>=0?(r=(t.min.y-d.y)*h,o=(t.max.y-d.y)*h):(r=(t.max.y-d.y)*h,o=(t.min.y-d.y)*h),n>o||r>s||((r>n||isNaN(n))&&(n=r),(o<s||isNaN(s))&&(s=o),u>=0?(a=(t.min.z-d.z)*u,c=(t.max.z-d.z)*u):(a=(t.max.z-d.z)*u,c=(t.min.z-d.z)*u),n>c||a>s)||((a>n||n!==n)&&(n=a),(c<s||s!==s)&&(s=c),s<0)?null:this.at(n>=0?n:s,e)}intersectsBox(t){return this.intersectBox(t,Hi)!==null}intersectTriangle(t,e,n,s,r){Ah.subVectors(e,t),Da.subVectors(n,t),Rh.crossVectors(Ah,Da);let o=this.direction.dot(Rh),a;if(o>0){if(s)return null;a=1}else if(o<0)a=-1,o=-o;else return null;us.subVectors(this.origin,t);let c=a*this.direction.dot(Da.crossVectors(us,Da));if(c<0)return null;let l=a*this.direction.dot(Ah.cross(us));if(l<0||c+l>o)return null;let h=-a*us.dot(Rh);return h<0?null:this.at(h/o,r)}applyMatrix4(t){return this.origin.applyMatrix4(t),this.direction.transformDirection(t),this}equals(t){return t.origin.equals(this.origin)&&t.direction.equals(this.direction)}clone(){return new this.constructor().copy(this)}},Re=class i{constructor(t,e,n,s,r,o,a,c,l,h,u,d,f,g,x,m){i.prototype.isMatrix4=!0,this.elements=[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],t!==void 0&&this.set(t,e,n,s,r,o,a,c,l,h,u,d,f,g,x,m)}set(t,e,n,s,r,o,a,c,l,h,u,d,f,g,x,m){let p=this.elements;return p[0]=t,p[4]=e,p[8]=n,p[12]=s,p[1]=r,p[5]=o,p[9]=a,p[13]=c,p[2]=l,p[6]=h,p[10]=u,p[14]=d,p[3]=f,p[7]=g,p[11]=x,p[15]=m,this}identity(){return this.set(1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1),this}clone(){return new i().fromArray(this.elements)}copy(t){let e=this.elements,n=t.elements;return e[0]=n[0],e[1]=n[1],e[2]=n[2],e[3]=n[3],e[4]=n[4],e[5]=n[5],e[6]=n[6],e[7]=n[7],e[8]=n[8],e[9]=n[9],e[10]=n[10],e[11]=n[11],e[12]=n[12],e[13]=n[13],e[14]=n[14],e[15]=n[15],this}copyPosition(t){let e=this.elements,n=t.elements;return e[12]=n[12],e[13]=n[13],e[14]=n[14],this}setFromMatrix3(t){let e=t.elements;return this.set(e[0],e[3],e[6],0,e[1],e[4],e[7],0,e[2],e[5],e[8],0,0,0,0,1),this}extractBasis(t,e,n){return t.setFromMatrixColumn(this,0),e.setFromMatrixColumn(this,1),n.setFromMatrixColumn(this,2),this}makeBasis(t,e,n){return this.set(t.x,e.x,n.x,0,t.y,e.y,n.y,0,t.z,e.z,n.z,0,0,0,0,1),this}extractRotation(t){let e=this.elements,n=t.elements,s=1/Ir.setFromMatrixColumn(t,0).length(),r=1/Ir.setFromMatrixColumn(t,1).length(),o=1/Ir.setFromMatrixColumn(t,2).length();return e[0]=n[0]*s,e[1]=n[1]*s,e[2]=n[2]*s,e[3]=0,e[4]=n[4]*r,e[5]=n[5]*r,e[6]=n[6]*r,e[7]=0,e[8]=n[8]*o,e[9]=n[9]*o,e[10]=n[10]*o,e[11]=0,e[12]=0,e[13]=0,e[14]=0,e[15]=1,this}makeRotationFromEuler(t){let e=this.elements,n=t.x,s=t.y,r=t.z,o=Math.cos(n),a=Math.sin(n),c=Math.cos(s),l=Math.sin(s),h=Math.cos(r),u=Math.sin(r);if(t.order==="XYZ"){let d=o*h,f=o*u,g=a*h,x=a*u;e[0]=c*h,e[4]=-c*u,e[8]=l,e[1]=f+g*l,e[5]=d-x*l,e[9]=-a*c,e[2]=x-d*l,e[6]=g+f*l,e[10]=o*c}else if(t.order==="YXZ"){let d=c*h,f=c*u,g=l*h,x=l*u;e[0]=d+x*a,e[4]=g*a-f,e[8]=o*l,e[1]=o*u,e[5]=o*h,e[9]=-a,e[2]=f*a-g,e[6]=x+d*a,e[10]=o*c}else if(t.order==="ZXY"){let d=c*h,f=c*u,g=l*h,x=l*u;e[0]=d-x*a,e[4]=-o*u,e[8]=g+f*a,e[1]=f+g*a,e[5]=o*h,e[9]=x-d*a,e[2]=-o*l,e[6]=a,e[10]=o*c}else if(t.order==="ZYX"){let d=o*h,f=o*u,g=a*h,x=a*u;e[0]=c*h,e[4]=g*l-f,e[8]=d*l+x,e[1]=c*u,e[5]=x*l+d,e[9]=f*l-g,e[2]=-l,e[6]=a*c,e[10]=o*c}else if(t.order==="YZX"){let d=o*c,f=o*l,g=a*c,x=a*l;e[0]=c*h,e[4]=x-d*u,e[8]=g*u+f,e[1]=u,e[5]=o*h,e[9]=-a*h,e[2]=-l*h,e[6]=f*u+g,e[10]=d-x*u}else if(t.order==="XZY"){let d=o*c,f=o*l,g=a*c,x=a*l;e[0]=c*h,e[4]=-u,e[8]=l*h,e[1]=d*u+x,e[5]=o*h,e[9]=f*u-g,e[2]=g*u-f,e[6]=a*h,e[10]=x*u+d}return e[3]=0,e[7]=0,e[11]=0,e[12]=0,e[13]=0,e[14]=0,e[15]=1,this}makeRotationFromQuaternion(t){return this.compose(fx,t,px)}lookAt(t,e,n){let s=this.elements;return Jn.subVectors(t,e),Jn.lengthSq()===0&&(Jn.z=1),Jn.normalize(),ds.crossVectors(n,Jn),ds.lengthSq()===0&&(Math.abs(n.z)===1?Jn.x+=1e-4:Jn.z+=1e-4,Jn.normalize(),ds.crossVectors(n,Jn)),ds.normalize(),Na.crossVectors(Jn,ds),s[0]=ds.x,s[4]=Na.x,s[8]=Jn.x,s[1]=ds.y,s[5]=Na.y,s[9]=Jn.y,s[2]=ds.z,s[6]=Na.z,s[10]=Jn.z,this}multiply(t){return this.multiplyMatrices(this,t)}premultiply(t){return this.multiplyMatrices(t,this)}multiplyMatrices(t,e){let n=t.elements,s=e.elements,r=this.elements,o=n[0],a=n[4],c=n[8],l=n[12],h=n[1],u=n[5],d=n[9],f=n[13],g=n[2],x=n[6],m=n[10],p=n[14],w=n[3],E=n[7],v=n[11],C=n[15],A=s[0],D=s[4],U=s[8],S=s[12],b=s[1],P=s[5],O=s[9],z=s[13],W=s[2],X=s[6],Y=s[10],j=s[14],K=s[3],at=s[7],lt=s[11],xt=s[15];return r[0]=o*A+a*b+c*W+l*K,r[4]=o*D+a*P+c*X+l*at,r[8]=o*U+a*O+c*Y+l*lt,r[12]=o*S+a*z+c*j+l*xt,r[1]=h*A+u*b+d*W+f*K,r[5]=h*D+u*P+d*X+f*at,r[9]=h*U+u*O+d*Y+f*lt,r[13]=h*S+u*z+d*j+f*xt,r[2]=g*A+x*b+m*W+p*K,r[6]=g*D+x*P+m*X+p*at,r[10]=g*U+x*O+m*Y+p*lt,r[14]=g*S+x*z+m*j+p*xt,r[3]=w*A+E*b+v*W+C*K,r[7]=w*D+E*P+v*X+C*at,r[11]=w*U+E*O+v*Y+C*lt,r[15]=w*S+E*z+v*j+C*xt,this}multiplyScalar(t){let e=this.elements;return e[0]*=t,e[4]*=t,e[8]*=t,e[12]*=t,e[1]*=t,e[5]*=t,e[9]*=t,e[13]*=t,e[2]*=t,e[6]*=t,e[10]*=t,e[14]*=t,e[3]*=t,e[7]*=t,e[11]*=t,e[15]*=t,this}determinant(){let t=this.elements,e=t[0],n=t[4],s=t[8],r=t[12],o=t[1],a=t[5],c=t[9],l=t[13],h=t[2],u=t[6],d=t[10],f=t[14],g=t[3],x=t[7],m=t[11],p=t[15];return g*(+r*c*u-s*l*u-r*a*d+n*l*d+s*a*f-n*c*f)+x*(+e*c*f-e*l*d+r*o*d-s*o*f+s*l*h-r*c*h)+m*(+e*l*u-e*a*f-r*o*u+n*o*f+r*a*h-n*l*h)+p*(-s*a*h-e*c*u+e*a*d+s*o*u-n*o*d+n*c*h)}transpose(){let t=this.elements,e;return e=t[1],t[1]=t[4],t[4]=e,e=t[2],t[2]=t[8],t[8]=e,e=t[6],t[6]=t[9],t[9]=e,e=t[3],t[3]=t[12],t[12]=e,e=t[7],t[7]=t[13],t[13]=e,e=t[11],t[11]=t[14],t[14]=e,this}setPosition(t,e,n){let s=this.elements;return t.isVector3?(s[12]=t.x,s[13]=t.y,s[14]=t.z):(s[12]=t,s[13]=e,s[14]=n),this}invert(){let t=this.elements,e=t[0],n=t[1],s=t[2],r=t[3],o=t[4],a=t[5],c=t[6],l=t[7],h=t[8],u=t[9],d=t[10],f=t[11],g=t[12],x=t[13],m=t[14],p=t[15],w=u*m*l-x*d*l+x*c*f-a*m*f-u*c*p+a*d*p,E=g*d*l-h*m*l-g*c*f+o*m*f+h*c*p-o*d*p,v=h*x*l-g*u*l+g*a*f-o*x*f-h*a*p+o*u*p,C=g*u*c-h*x*c-g*a*d+o*x*d+h*a*m-o*u*m,A=e*w+n*E+s*v+r*C;if(A===0)return this.set(0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0);let D=1/A;return t[0]=w*D,t[1]=(x*d*r-u*m*r-x*s*f+n*m*f+u*s*p-n*d*p)*D,t[2]=(a*m*r-x*c*r+x*s*l-n*m*l-a*s*p+n*c*p)*D,t[3]=(u*c*r-a*d*r-u*s*l+n*d*l+a*s*f-n*c*f)*D,t[4]=E*D,t[5]=(h*m*r-g*d*r+g*s*f-e*m*f-h*s*p+e*d*p)*D,t[6]=(g*c*r-o*m*r-g*s*l+e*m*l+o*s*p-e*c*p)*D,t[7]=(o*d*r-h*c*r+h*s*l-e*d*l-o*s*f+e*c*f)*D,t[8]=v*D,t[9]=(g*u*r-h*x*r-g*n*f+e*x*f+h*n*p-e*u*p)*D,t[10]=(o*x*r-g*a*r+g*n*l-e*x*l-o*n*p+e*a*p)*D,t[11]=(h*a*r-o*u*r-h*n*l+e*u*l+o*n*f-e*a*f)*D,t[12]=C*D,t[13]=(h*x*s-g*u*s+g*n*d-e*x*d-h*n*m+e*u*m)*D,t[14]=(g*a*s-o*x*s-g*n*c+e*x*c+o*n*m-e*a*m)*D,t[15]=(o*u*s-h*a*s+h*n*c-e*u*c-o*n*d+e*a*d)*D,this}scale(t){let e=this.elements,n=t.x,s=t.y,r=t.z;return e[0]*=n,e[4]*=s,e[8]*=r,e[1]*=n,e[5]*=s,e[9]*=r,e[2]*=n,e[6]*=s,e[10]*=r,e[3]*=n,e[7]*=s,e[11]*=r,this}getMaxScaleOnAxis(){let t=this.elements,e=t[0]*t[0]+t[1]*t[1]+t[2]*t[2],n=t[4]*t[4]+t[5]*t[5]+t[6]*t[6],s=t[8]*t[8]+t[9]*t[9]+t[10]*t[10];return Math.sqrt(Math.max(e,n,s))}makeTranslation(t,e,n){return t.isVector3?this.set(1,0,0,t.x,0,1,0,t.y,0,0,1,t.z,0,0,0,1):this.set(1,0,0,t,0,1,0,e,0,0,1,n,0,0,0,1),this}makeRotationX(t){let e=Math.cos(t),n=Math.sin(t);return this.set(1,0,0,0,0,e,-n,0,0,n,e,0,0,0,0,1),this}makeRotationY(t){let e=Math.cos(t),n=Math.sin(t);return this.set(e,0,n,0,0,1,0,0,-n,0,e,0,0,0,0,1),this}makeRotationZ(t){let e=Math.cos(t),n=Math.sin(t);return this.set(e,-n,0,0,n,e,0,0,0,0,1,0,0,0,0,1),this}makeRotationAxis(t,e){let n=Math.cos(e),s=Math.sin(e),r=1-n,o=t.x,a=t.y,c=t.z,l=r*o,h=r*a;return this.set(l*o+n,l*a-s*c,l*c+s*a,0,l*a+s*c,h*a+n,h*c-s*o,0,l*c-s*a,h*c+s*o,r*c*c+n,0,0,0,0,1),this}makeScale(t,e,n){return this.set(t,0,0,0,0,e,0,0,0,0,n,0,0,0,0,1),this}makeShear(t,e,n,s,r,o){return this.set(1,n,r,0,t,1,o,0,e,s,1,0,0,0,0,1),this}compose(t,e,n){let s=this.elements,r=e._x,o=e._y,a=e._z,c=e._w,l=r+r,h=o+o,u=a+a,d=r*l,f=r*h,g=r*u,x=o*h,m=o*u,p=a*u,w=c*l,E=c*h,v=c*u,C=n.x,A=n.y,D=n.z;return s[0]=(1-(x+p))*C,s[1]=(f+v)*C,s[2]=(g-E)*C,s[3]=0,s[4]=(f-v)*A,s[5]=(1-(d+p))*A,s[6]=(m+w)*A,s[7]=0,s[8]=(g+E)*D,s[9]=(m-w)*D,s[10]=(1-(d+x))*D,s[11]=0,s[12]=t.x,s[13]=t.y,s[14]=t.z,s[15]=1,this}decompose(t,e,n){let s=this.elements,r=Ir.set(s[0],s[1],s[2]).length(),o=Ir.set(s[4],s[5],s[6]).length(),a=Ir.set(s[8],s[9],s[10]).length();this.determinant()<0&&(r=-r),t.x=s[12],t.y=s[13],t.z=s[14],_i.copy(this);let l=1/r,h=1/o,u=1/a;return _i.elements[0]*=l,_i.elements[1]*=l,_i.elements[2]*=l,_i.elements[4]*=h,_i.elements[5]*=h,_i.elements[6]*=h,_i.elements[8]*=u,_i.elements[9]*=u,_i.elements[10]*=u,e.setFromRotationMatrix(_i),n.x=r,n.y=o,n.z=a,this}makePerspective(t,e,n,s,r,o,a=vi,c=!1){let l=this.elements,h=2*r/(e-t),u=2*r/(n-s),d=(e+t)/(e-t),f=(n+s)/(n-s),g,x;if(c)g=r/(o-r),x=o*r/(o-r);else if(a===vi)g=-(o+r)/(o-r),x=-2*o*r/(o-r);else if(a===Lo)g=-o/(o-r),x=-o*r/(o-r);else throw new Error("THREE.Matrix4.makePerspective(): Invalid coordinate system: "+a);return l[0]=h,l[4]=0,l[8]=d,l[12]=0,l[1]=0,l[5]=u,l[9]=f,l[13]=0,l[2]=0,l[6]=0,l[10]=g,l[14]=x,l[3]=0,l[7]=0,l[11]=-1,l[15]=0,this}makeOrthographic(t,e,n,s,r,o,a=vi,c=!1){let l=this.elements,h=2/(e-t),u=2/(n-s),d=-(e+t)/(e-t),f=-(n+s)/(n-s),g,x;if(c)g=1/(o-r),x=o/(o-r);else if(a===vi)g=-2/(o-r),x=-(o+r)/(o-r);else if(a===Lo)g=-1/(o-r),x=-r/(o-r);else throw new Error("THREE.Matrix4.makeOrthographic(): Invalid coordinate system: "+a);return l[0]=h,l[4]=0,l[8]=0,l[12]=d,l[1]=0,l[5]=u,l[9]=0,l[13]=f,l[2]=0,l[6]=0,l[10]=g,l[14]=x,l[3]=0,l[7]=0,l[11]=0,l[15]=1,this}equals(t){let e=this.elements,n=t.elements;for(let s=0;s<16;s++)if(e[s]!==n[s])return!1;return!0}fromArray(t,e=0){for(let n=0;n<16;n++)this.elements[n]=t[n+e];return this}toArray(t=[],e=0){let n=this.elements;return t[e]=n[0],t[e+1]=n[1],t[e+2]=n[2],t[e+3]=n[3],t[e+4]=n[4],t[e+5]=n[5],t[e+6]=n[6],t[e+7]=n[7],t[e+8]=n[8],t[e+9]=n[9],t[e+10]=n[10],t[e+11]=n[11],t[e+12]=n[12],t[e+13]=n[13],t[e+14]=n[14],t[e+15]=n[15],t}},Ir=new H,_i=new Re,fx=new H(0,0,0),px=new H(1,1,1),ds=new H,Na=new H,Jn=new H,ip=new Re,sp=new Un,Li=class i{constructor(t=0,e=0,n=0,s=i.DEFAULT_ORDER){this.isEuler=!0,this._x=t,this._y=e,this._z=n,this._order=s}get x(){return this._x}set x(t){this._x=t,this._onChangeCallback()}get y(){return this._y}set y(t){this._y=t,this._onChangeCallback()}get z(){return this._z}set z(t){this._z=t,this._onChangeCallback()}get order(){return this._order}set order(t){this._order=t,this._onChangeCallback()}set(t,e,n,s=this._order){return this._x=t,this._y=e,this._z=n,this._order=s,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._order)}copy(t){return this._x=t._x,this._y=t._y,this._z=t._z,this._order=t._order,this._onChangeCallback(),this}setFromRotationMatrix(t,e=this._order,n=!0){let s=t.elements,r=s[0],o=s[4],a=s[8],c=s[1],l=s[5],h=s[9],u=s[2],d=s[6],f=s[10];switch(e){case"XYZ":this._y=Math.asin(le(a,-1,1)),Math.abs(a)<.9999999?(this._x=Math.atan2(-h,f),this._z=Math.atan2(-o,r)):(this._x=Math.atan2(d,l),this._z=0);break;case"YXZ":this._x=Math.asin(-le(h,-1,1)),Math.abs(h)<.9999999?(this._y=Math.atan2(a,f),this._z=Math.atan2(c,l)):(this._y=Math.atan2(-u,r),this._z=0);break;case"ZXY":this._x=Math.asin(le(d,-1,1)),Math.abs(d)<.9999999?(this._y=Math.atan2(-u,f),this._z=Math.atan2(-o,l)):(this._y=0,this._z=Math.atan2(c,r));break;case"ZYX":this._y=Math.asin(-le(u,-1,1)),Math.abs(u)<.9999999?(this._x=Math.atan2(d,f),this._z=Math.atan2(c,r)):(this._x=0,this._z=Math.atan2(-o,l));break;case"YZX":this._z=Math.asin(le(c,-1,1)),Math.abs(c)<.9999999?(this._x=Math.atan2(-h,l),this._y=Math.atan2(-u,r)):(this._x=0,this._y=Math.atan2(a,f));break;case"XZY":this._z=Math.asin(-le(o,-1,1)),Math.abs(o)<.9999999?(this._x=Math.atan2(d,l),this._y=Math.atan2(a,r)):(this._x=Math.atan2(-h,f),this._y=0);break;default:console.warn("THREE.Euler: .setFromRotationMatrix() encountered an unknown order: "+e)}return this._order=e,n===!0&&this._onChangeCallback(),this}setFromQuaternion(t,e,n){return ip.makeRotationFromQuaternion(t),this.setFromRotationMatrix(ip,e,n)}setFromVector3(t,e=this._order){return this.set(t.x,t.y,t.z,e)}reorder(t){return sp.setFromEuler(this),this.setFromQuaternion(sp,t)}equals(t){return t._x===this._x&&t._y===this._y&&t._z===this._z&&t._order===this._order}fromArray(t){return this._x=t[0],this._y=t[1],this._z=t[2],t[3]!==void 0&&(this._order=t[3]),this._onChangeCallback(),this}toArray(t=[],e=0){return t[e]=this._x,t[e+1]=this._y,t[e+2]=this._z,t[e+3]=this._order,t}_onChange(t){return this._onChangeCallback=t,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._order}};Li.DEFAULT_ORDER="XYZ";var Uo=class{constructor(){this.mask=1}set(t){this.mask=(1<<t|0)>>>0}enable(t){this.mask|=1<<t|0}enableAll(){this.mask=-1}toggle(t){this.mask^=1<<t|0}disable(t){this.mask&=~(1<<t|0)}disableAll(){this.mask=0}test(t){return(this.mask&t.mask)!==0}isEnabled(t){return(this.mask&(1<<t|0))!==0}},mx=0,rp=new H,Lr=new Un,Gi=new Re,Ua=new H,wo=new H,gx=new H,_x=new Un,op=new H(1,0,0),ap=new H(0,1,0),lp=new H(0,0,1),cp={type:"added"},xx={type:"removed"},Dr={type:"childadded",child:null},Ch={type:"childremoved",child:null},ai=class i extends Pi{constructor(){super(),this.isObject3D=!0,Object.defineProperty(this,"id",{value:mx++}),this.uuid=Yi(),this.name="",this.type="Object3D",this.parent=null,this.children=[],this.up=i.DEFAULT_UP.clone();let t=new H,e=new Li,n=new Un,s=new H(1,1,1);function r(){n.setFromEuler(e,!1)}function o(){e.setFromQuaternion(n,void 0,!1)}e._onChange(r),n._onChange(o),Object.defineProperties(this,{position:{configurable:!0,enumerable:!0,value:t},rotation:{configurable:!0,enumerable:!0,value:e},quaternion:{configurable:!0,enumerable:!0,value:n},scale:{configurable:!0,enumerable:!0,value:s},modelViewMatrix:{value:new Re},normalMatrix:{value:new re}}),this.matrix=new Re,this.matrixWorld=new Re,this.matrixAutoUpdate=i.DEFAULT_MATRIX_AUTO_UPDATE,this.matrixWorldAutoUpdate=i.DEFAULT_MATRIX_WORLD_AUTO_UPDATE,this.matrixWorldNeedsUpdate=!1,this.layers=new Uo,this.visible=!0,this.castShadow=!1,this.receiveShadow=!1,this.frustumCulled=!0,this.renderOrder=0,this.animations=[],this.customDepthMaterial=void 0,this.customDistanceMaterial=void 0,this.userData={}}onBeforeShadow(){}onAfterShadow(){}onBeforeRender(){}onAfterRender(){}applyMatrix4(t){this.matrixAutoUpdate&&this.updateMatrix(),this.matrix.premultiply(t),this.matrix.decompose(this.position,this.quaternion,this.scale)}applyQuaternion(t){return this.quaternion.premultiply(t),this}setRotationFromAxisAngle(t,e){this.quaternion.setFromAxisAngle(t,e)}setRotationFromEuler(t){this.quaternion.setFromEuler(t,!0)}setRotationFromMatrix(t){this.quaternion.setFromRotationMatrix(t)}setRotationFromQuaternion(t){this.quaternion.copy(t)}rotateOnAxis(t,e){return Lr.setFromAxisAngle(t,e),this.quaternion.multiply(Lr),this}rotateOnWorldAxis(t,e){return Lr.setFromAxisAngle(t,e),this.quaternion.premultiply(Lr),this}rotateX(t){return this.rotateOnAxis(op,t)}rotateY(t){return this.rotateOnAxis(ap,t)}rotateZ(t){return this.rotateOnAxis(lp,t)}translateOnAxis(t,e){return rp.copy(t).applyQuaternion(this.quaternion),this.position.add(rp.multiplyScalar(e)),this}translateX(t){return this.translateOnAxis(op,t)}translateY(t){return this.translateOnAxis(ap,t)}translateZ(t){return this.translateOnAxis(lp,t)}localToWorld(t){return this.updateWorldMatrix(!0,!1),t.applyMatrix4(this.matrixWorld)}worldToLocal(t){return this.updateWorldMatrix(!0,!1),t.applyMatrix4(Gi.copy(this.matrixWorld).invert())}lookAt(t,e,n){t.isVector3?Ua.copy(t):Ua.set(t,e,n);let s=this.parent;this.updateWorldMatrix(!0,!1),wo.setFromMatrixPosition(this.matrixWorld),this.isCamera||this.isLight?Gi.lookAt(wo,Ua,this.up):Gi.lookAt(Ua,wo,this.up),this.quaternion.setFromRotationMatrix(Gi),s&&(Gi.extractRotation(s.matrixWorld),Lr.setFromRotationMatrix(Gi),this.quaternion.premultiply(Lr.invert()))}add(t){if(arguments.length>1){for(let e=0;e<arguments.length;e++)this.add(arguments[e]);return this}return t===this?(console.error("THREE.Object3D.add: object can't be added as a child of itself.",t),this):(t&&t.isObject3D?(t.removeFromParent(),t.parent=this,this.children.push(t),t.dispatchEvent(cp),Dr.child=t,this.dispatchEvent(Dr),Dr.child=null):console.error("THREE.Object3D.add: object not an instance of THREE.Object3D.",t),this)}remove(t){if(arguments.length>1){for(let n=0;n<arguments.length;n++)this.remove(arguments[n]);return this}let e=this.children.indexOf(t);return e!==-1&&(t.parent=null,this.children.splice(e,1),t.dispatchEvent(xx),Ch.child=t,this.dispatchEvent(Ch),Ch.child=null),this}removeFromParent(){let t=this.parent;return t!==null&&t.remove(this),this}clear(){return this.remove(...this.children)}attach(t){return this.updateWorldMatrix(!0,!1),Gi.copy(this.matrixWorld).invert(),t.parent!==null&&(t.parent.updateWorldMatrix(!0,!1),Gi.multiply(t.parent.matrixWorld)),t.applyMatrix4(Gi),t.removeFromParent(),t.parent=this,this.children.push(t),t.updateWorldMatrix(!1,!0),t.dispatchEvent(cp),Dr.child=t,this.dispatchEvent(Dr),Dr.child=null,this}getObjectById(t){return this.getObjectByProperty("id",t)}getObjectByName(t){return this.getObjectByProperty("name",t)}getObjectByProperty(t,e){if(this[t]===e)return this;for(let n=0,s=this.children.length;n<s;n++){let o=this.children[n].getObjectByProperty(t,e);if(o!==void 0)return o}}getObjectsByProperty(t,e,n=[]){this[t]===e&&n.push(this);let s=this.children;for(let r=0,o=s.length;r<o;r++)s[r].getObjectsByProperty(t,e,n);return n}getWorldPosition(t){return this.updateWorldMatrix(!0,!1),t.setFromMatrixPosition(this.matrixWorld)}getWorldQuaternion(t){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(wo,t,gx),t}getWorldScale(t){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(wo,_x,t),t}getWorldDirection(t){this.updateWorldMatrix(!0,!1);let e=this.matrixWorld.elements;return t.set(e[8],e[9],e[10]).normalize()}raycast(){}traverse(t){t(this);let e=this.children;for(let n=0,s=e.length;n<s;n++)e[n].traverse(t)}traverseVisible(t){if(this.visible===!1)return;t(this);let e=this.children;for(let n=0,s=e.length;n<s;n++)e[n].traverseVisible(t)}traverseAncestors(t){let e=this.parent;e!==null&&(t(e),e.traverseAncestors(t))}updateMatrix(){this.matrix.compose(this.position,this.quaternion,this.scale),this.matrixWorldNeedsUpdate=!0}updateMatrixWorld(t){this.matrixAutoUpdate&&this.updateMatrix(),(this.matrixWorldNeedsUpdate||t)&&(this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),this.matrixWorldNeedsUpdate=!1,t=!0);let e=this.children;for(let n=0,s=e.length;n<s;n++)e[n].updateMatrixWorld(t)}updateWorldMatrix(t,e){let n=this.parent;if(t===!0&&n!==null&&n.updateWorldMatrix(!0,!1),this.matrixAutoUpdate&&this.updateMatrix(),this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),e===!0){let s=this.children;for(let r=0,o=s.length;r<o;r++)s[r].updateWorldMatrix(!1,!0)}}toJSON(t){let e=t===void 0||typeof t=="string",n={};e&&(t={geometries:{},materials:{},textures:{},images:{},shapes:{},skeletons:{},animations:{},nodes:{}},n.metadata={version:4.7,type:"Object",generator:"Object3D.toJSON"});let s={};s.uuid=this.uuid,s.type=this.type,this.name!==""&&(s.name=this.name),this.castShadow===!0&&(s.castShadow=!0),this.receiveShadow===!0&&(s.receiveShadow=!0),this.visible===!1&&(s.visible=!1),this.frustumCulled===!1&&(s.frustumCulled=!1),this.renderOrder!==0&&(s.renderOrder=this.renderOrder),Object.keys(this.userData).length>0&&(s.userData=this.userData),s.layers=this.layers.mask,s.matrix=this.matrix.toArray(),s.up=this.up.toArray(),this.matrixAutoUpdate===!1&&(s.matrixAutoUpdate=!1),this.isInstancedMesh&&(s.type="InstancedMesh",s.count=this.count,s.instanceMatrix=this.instanceMatrix.toJSON(),this.instanceColor!==null&&(s.instanceColor=this.instanceColor.toJSON())),this.isBatchedMesh&&(s.type="BatchedMesh",s.perObjectFrustumCulled=this.perObjectFrustumCulled,s.sortObjects=this.sortObjects,s.drawRanges=this._drawRanges,s.reservedRanges=this._reservedRanges,s.geometryInfo=this._geometryInfo.map(a=>({...a,boundingBox:a.boundingBox?a.boundingBox.toJSON():void 0,boundingSphere:a.boundingSphere?a.boundingSphere.toJSON():void 0})),s.instanceInfo=this._instanceInfo.map(a=>({...a})),s.availableInstanceIds=this._availableInstanceIds.slice(),s.availableGeometryIds=this._availableGeometryIds.slice(),s.nextIndexStart=this._nextIndexStart,s.nextVertexStart=this._nextVertexStart,s.geometryCount=this._geometryCount,s.maxInstanceCount=this._maxInstanceCount,s.maxVertexCount=this._maxVertexCount,s.maxIndexCount=this._maxIndexCount,s.geometryInitialized=this._geometryInitialized,s.matricesTexture=this._matricesTexture.toJSON(t),s.indirectTexture=this._indirectTexture.toJSON(t),this._colorsTexture!==null&&(s.colorsTexture=this._colorsTexture.toJSON(t)),this.boundingSphere!==null&&(s.boundingSphere=this.boundingSphere.toJSON()),this.boundingBox!==null&&(s.boundingBox=this.boundingBox.toJSON()));function r(a,c){return a[c.uuid]===void 0&&(a[c.uuid]=c.toJSON(t)),c.uuid}if(this.isScene)this.background&&(this.background.isColor?s.background=this.background.toJSON():this.background.isTexture&&(s.background=this.background.toJSON(t).uuid)),this.environment&&this.environment.isTexture&&this.environment.isRenderTargetTexture!==!0&&(s.environment=this.environment.toJSON(t).uuid);else if(this.isMesh||this.isLine||this.isPoints){s.geometry=r(t.geometries,this.geometry);let a=this.geometry.parameters;if(a!==void 0&&a.shapes!==void 0){let c=a.shapes;if(Array.isArray(c))for(let l=0,h=c.length;l<h;l++){let u=c[l];r(t.shapes,u)}else r(t.shapes,c)}}if(this.isSkinnedMesh&&(s.bindMode=this.bindMode,s.bindMatrix=this.bindMatrix.toArray(),this.skeleton!==void 0&&(r(t.skeletons,this.skeleton),s.skeleton=this.skeleton.uuid)),this.material!==void 0)if(Array.isArray(this.material)){let a=[];for(let c=0,l=this.material.length;c<l;c++)a.push(r(t.materials,this.material[c]));s.material=a}else s.material=r(t.materials,this.material);if(this.children.length>0){s.children=[];for(let a=0;a<this.children.length;a++)s.children.push(this.children[a].toJSON(t).object)}if(this.animations.length>0){s.animations=[];for(let a=0;a<this.animations.length;a++){let c=this.animations[a];s.animations.push(r(t.animations,c))}}if(e){let a=o(t.geometries),c=o(t.materials),l=o(t.textures),h=o(t.images),u=o(t.shapes),d=o(t.skeletons),f=o(t.animations),g=o(t.nodes);a.length>0&&(n.geometries=a),c.length>0&&(n.materials=c),l.length>0&&(n.textures=l),h.length>0&&(n.images=h),u.length>0&&(n.shapes=u),d.length>0&&(n.skeletons=d),f.length>0&&(n.animations=f),g.length>0&&(n.nodes=g)}return n.object=s,n;function o(a){let c=[];for(let l in a){let h=a[l];delete h.metadata,c.push(h)}return c}}clone(t){return new this.constructor().copy(this,t)}copy(t,e=!0){if(this.name=t.name,this.up.copy(t.up),this.position.copy(t.position),this.rotation.order=t.rotation.order,this.quaternion.copy(t.quaternion),this.scale.copy(t.scale),this.matrix.copy(t.matrix),this.matrixWorld.copy(t.matrixWorld),this.matrixAutoUpdate=t.matrixAutoUpdate,this.matrixWorldAutoUpdate=t.matrixWorldAutoUpdate,this.matrixWorldNeedsUpdate=t.matrixWorldNeedsUpdate,this.layers.mask=t.layers.mask,this.visible=t.visible,this.castShadow=t.castShadow,this.receiveShadow=t.receiveShadow,this.frustumCulled=t.frustumCulled,this.renderOrder=t.renderOrder,this.animations=t.animations.slice(),this.userData=JSON.parse(JSON.stringify(t.userData)),e===!0)for(let n=0;n<t.children.length;n++){let s=t.children[n];this.add(s.clone())}return this}};ai.DEFAULT_UP=new H(0,1,0);ai.DEFAULT_MATRIX_AUTO_UPDATE=!0;ai.DEFAULT_MATRIX_WORLD_AUTO_UPDATE=!0;var xi=new H,Wi=new H,Ph=new H,Xi=new H,Nr=new H,Ur=new H,hp=new H,Ih=new H,Lh=new H,Dh=new H,Nh=new Ze,Uh=new Ze,Fh=new Ze,ms=class i{constructor(t=new H,e=new H,n=new H){this.a=t,this.b=e,this.c=n}static getNormal(t,e,n,s){s.subVectors(n,e),xi.subVectors(t,e),s.cross(xi);let r=s.lengthSq();return r>0?s.multiplyScalar(1/Math.sqrt(r)):s.set(0,0,0)}static getBarycoord(t,e,n,s,r){xi.subVectors(s,e),Wi.subVectors(n,e),Ph.subVectors(t,e);let o=xi.dot(xi),a=xi.dot(Wi),c=xi.dot(Ph),l=Wi.dot(Wi),h=Wi.dot(Ph),u=o*l-a*a;if(u===0)return r.set(0,0,0),null;let d=1/u,f=(l*c-a*h)*d,g=(o*h-a*c)*d;return r.set(1-f-g,g,f)}static containsPoint(t,e,n,s){return this.getBarycoord(t,e,n,s,Xi)===null?!1:Xi.x>=0&&Xi.y>=0&&Xi.x+Xi.y<=1}static getInterpolation(t,e,n,s,r,o,a,c){return this.getBarycoord(t,e,n,s,Xi)===null?(c.x=0,c.y=0,"z"in c&&(c.z=0),"w"in c&&(c.w=0),null):(c.setScalar(0),c.addScaledVector(r,Xi.x),c.addScaledVector(o,Xi.y),c.addScaledVector(a,Xi.z),c)}static getInterpolatedAttribute(t,e,n,s,r,o){return Nh.setScalar(0),Uh.setScalar(0),Fh.setScalar(0),Nh.fromBufferAttribute(t,e),Uh.fromBufferAttribute(t,n),Fh.fromBufferAttribute(t,s),o.setScalar(0),o.addScaledVector(Nh,r.x),o.addScaledVector(Uh,r.y),o.addScaledVector(Fh,r.z),o}static isFrontFacing(t,e,n,s){return xi.subVectors(n,e),Wi.subVectors(t,e),xi.cross(Wi).dot(s)<0}set(t,e,n){return this.a.copy(t),this.b.copy(e),this.c.copy(n),this}setFromPointsAndIndices(t,e,n,s){return this.a.copy(t[e]),this.b.copy(t[n]),this.c.copy(t[s]),this}setFromAttributeAndIndices(t,e,n,s){return this.a.fromBufferAttribute(t,e),this.b.fromBufferAttribute(t,n),this.c.fromBufferAttribute(t,s),this}clone(){return new this.constructor().copy(this)}copy(t){return this.a.copy(t.a),this.b.copy(t.b),this.c.copy(t.c),this}getArea(){return xi.subVectors(this.c,this.b),Wi.subVectors(this.a,this.b),xi.cross(Wi).length()*.5}getMidpoint(t){return t.addVectors(this.a,this.b).add(this.c).multiplyScalar(1/3)}getNormal(t){return i.getNormal(this.a,this.b,this.c,t)}getPlane(t){return t.setFromCoplanarPoints(this.a,this.b,this.c)}getBarycoord(t,e){return i.getBarycoord(t,this.a,this.b,this.c,e)}getInterpolation(t,e,n,s,r){return i.getInterpolation(t,this.a,this.b,this.c,e,n,s,r)}containsPoint(t){return i.containsPoint(t,this.a,this.b,this.c)}isFrontFacing(t){return i.isFrontFacing(this.a,this.b,this.c,t)}intersectsBox(t){return t.intersectsTriangle(this)}closestPointToPoint(t,e){let n=this.a,s=this.b,r=this.c,o,a;Nr.subVectors(s,n),Ur.subVectors(r,n),Ih.subVectors(t,n);let c=Nr.dot(Ih),l=Ur.dot(Ih);if(c<=0&&l<=0)return e.copy(n);Lh.subVectors(t,s);let h=Nr.dot(Lh),u=Ur.dot(Lh);if(h>=0&&u<=h)return e.copy(s);let d=c*u-h*l;if(d<=0&&c>=0&&h<=0)return o=c/(c-h),e.copy(n).addScaledVector(Nr,o);Dh.subVectors(t,r);let f=Nr.dot(Dh),g=Ur.dot(Dh);if(g>=0&&f<=g)return e.copy(r);let x=f*l-c*g;if(x<=0&&l>=0&&g<=0)return a=l/(l-g),e.copy(n).addScaledVector(Ur,a);let m=h*g-f*u;if(m<=0&&u-h>=0&&f-g>=0)return hp.subVectors(r,s),a=(u-h)/(u-h+(f-g)),e.copy(s).addScaledVector(hp,a);let p=1/(m+x+d);return o=x*p,a=d*p,e.copy(n).addScaledVector(Nr,o).addScaledVector(Ur,a)}equals(t){return t.a.equals(this.a)&&t.b.equals(this.b)&&t.c.equals(this.c)}},lm={aliceblue:15792383,antiquewhite:16444375,aqua:65535,aquamarine:8388564,azure:15794175,beige:16119260,bisque:16770244,black:0,blanchedalmond:16772045,blue:255,blueviolet:9055202,brown:10824234,burlywood:14596231,cadetblue:6266528,chartreuse:8388352,chocolate:13789470,coral:16744272,cornflowerblue:6591981,cornsilk:16775388,crimson:14423100,cyan:65535,darkblue:139,darkcyan:35723,darkgoldenrod:12092939,darkgray:11119017,darkgreen:25600,darkgrey:11119017,darkkhaki:12433259,darkmagenta:9109643,darkolivegreen:5597999,darkorange:16747520,darkorchid:10040012,darkred:9109504,darksalmon:15308410,darkseagreen:9419919,darkslateblue:4734347,darkslategray:3100495,darkslategrey:3100495,darkturquoise:52945,darkviolet:9699539,deeppink:16716947,deepskyblue:49151,dimgray:6908265,dimgrey:6908265,dodgerblue:2003199,firebrick:11674146,floralwhite:16775920,forestgreen:2263842,fuchsia:16711935,gainsboro:14474460,ghostwhite:16316671,gold:16766720,goldenrod:14329120,gray:8421504,green:32768,greenyellow:11403055,grey:8421504,honeydew:15794160,hotpink:16738740,indianred:13458524,indigo:4915330,ivory:16777200,khaki:15787660,lavender:15132410,lavenderblush:16773365,lawngreen:8190976,lemonchiffon:16775885,lightblue:11393254,lightcoral:15761536,lightcyan:14745599,lightgoldenrodyellow:16448210,lightgray:13882323,lightgreen:9498256,lightgrey:13882323,lightpink:16758465,lightsalmon:16752762,lightseagreen:2142890,lightskyblue:8900346,lightslategray:7833753,lightslategrey:7833753,lightsteelblue:11584734,lightyellow:16777184,lime:65280,limegreen:3329330,linen:16445670,magenta:16711935,maroon:8388608,mediumaquamarine:6737322,mediumblue:205,mediumorchid:12211667,mediumpurple:9662683,mediumseagreen:3978097,mediumslateblue:8087790,mediumspringgreen:64154,mediumturquoise:4772300,mediumvioletred:13047173,midnightblue:1644912,mintcream:16121850,mistyrose:16770273,moccasin:16770229,navajowhite:16768685,navy:128,oldlace:16643558,olive:8421376,olivedrab:7048739,orange:16753920,orangered:16729344,orchid:14315734,palegoldenrod:15657130,palegreen:10025880,paleturquoise:11529966,palevioletred:14381203,papayawhip:16773077,peachpuff:16767673,peru:13468991,pink:16761035,plum:14524637,powderblue:11591910,purple:8388736,rebeccapurple:6697881,red:16711680,rosybrown:12357519,royalblue:4286945,saddlebrown:9127187,salmon:16416882,sandybrown:16032864,seagreen:3050327,seashell:16774638,sienna:10506797,silver:12632256,skyblue:8900331,slateblue:6970061,slategray:7372944,slategrey:7372944,snow:16775930,springgreen:65407,steelblue:4620980,tan:13808780,teal:32896,thistle:14204888,tomato:16737095,turquoise:4251856,violet:15631086,wheat:16113331,white:16777215,whitesmoke:16119285,yellow:16776960,yellowgreen:10145074},fs={h:0,s:0,l:0},Fa={h:0,s:0,l:0};function Oh(i,t,e){return e<0&&(e+=1),e>1&&(e-=1),e<1/6?i+(t-i)*6*e:e<1/2?t:e<2/3?i+(t-i)*6*(2/3-e):i}var jt=class{constructor(t,e,n){return this.isColor=!0,this.r=1,this.g=1,this.b=1,this.set(t,e,n)}set(t,e,n){if(e===void 0&&n===void 0){let s=t;s&&s.isColor?this.copy(s):typeof s=="number"?this.setHex(s):typeof s=="string"&&this.setStyle(s)}else this.setRGB(t,e,n);return this}setScalar(t){return this.r=t,this.g=t,this.b=t,this}setHex(t,e=Nn){return t=Math.floor(t),this.r=(t>>16&255)/255,this.g=(t>>8&255)/255,this.b=(t&255)/255,fe.colorSpaceToWorking(this,e),this}setRGB(t,e,n,s=fe.workingColorSpace){return this.r=t,this.g=e,this.b=n,fe.colorSpaceToWorking(this,s),this}setHSL(t,e,n,s=fe.workingColorSpace){if(t=lu(t,1),e=le(e,0,1),n=le(n,0,1),e===0)this.r=this.g=this.b=n;else{let r=n<=.5?n*(1+e):n+e-n*e,o=2*n-r;this.r=Oh(o,r,t+1/3),this.g=Oh(o,r,t),this.b=Oh(o,r,t-1/3)}return fe.colorSpaceToWorking(this,s),this}setStyle(t,e=Nn){function n(r){r!==void 0&&parseFloat(r)<1&&console.warn("THREE.Color: Alpha component of "+t+" will be ignored.")}let s;if(s=/^(\w+)\(([^\)]*)\)/.exec(t)){let r,o=s[1],a=s[2];switch(o){case"rgb":case"rgba":if(r=/^\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(a))return n(r[4]),this.setRGB(Math.min(255,parseInt(r[1],10))/255,Math.min(255,parseInt(r[2],10))/255,Math.min(255,parseInt(r[3],10))/255,e);if(r=/^\s*(\d+)\%\s*,\s*(\d+)\%\s*,\s*(\d+)\%\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(a))return n(r[4]),this.setRGB(Math.min(100,parseInt(r[1],10))/100,Math.min(100,parseInt(r[2],10))/100,Math.min(100,parseInt(r[3],10))/100,e);break;case"hsl":case"hsla":if(r=/^\s*(\d*\.?\d+)\s*,\s*(\d*\.?\d+)\%\s*,\s*(\d*\.?\d+)\%\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(a))return n(r[4]),this.setHSL(parseFloat(r[1])/360,parseFloat(r[2])/100,parseFloat(r[3])/100,e);break;default:console.warn("THREE.Color: Unknown color model "+t)}}else if(s=/^\#([A-Fa-f\d]+)$/.exec(t)){let r=s[1],o=r.length;if(o===3)return this.setRGB(parseInt(r.charAt(0),16)/15,parseInt(r.charAt(1),16)/15,parseInt(r.charAt(2),16)/15,e);if(o===6)return this.setHex(parseInt(r,16),e);console.warn("THREE.Color: Invalid hex color "+t)}else if(t&&t.length>0)return this.setColorName(t,e);return this}setColorName(t,e=Nn){let n=lm[t.toLowerCase()];return n!==void 0?this.setHex(n,e):console.warn("THREE.Color: Unknown color "+t),this}clone(){return new this.constructor(this.r,this.g,this.b)}copy(t){return this.r=t.r,this.g=t.g,this.b=t.b,this}copySRGBToLinear(t){return this.r=$i(t.r),this.g=$i(t.g),this.b=$i(t.b),this}copyLinearToSRGB(t){return this.r=zr(t.r),this.g=zr(t.g),this.b=zr(t.b),this}convertSRGBToLinear(){return this.copySRGBToLinear(this),this}convertLinearToSRGB(){return this.copyLinearToSRGB(this),this}getHex(t=Nn){return fe.workingToColorSpace(Sn.copy(this),t),Math.round(le(Sn.r*255,0,255))*65536+Math.round(le(Sn.g*255,0,255))*256+Math.round(le(Sn.b*255,0,255))}getHexString(t=Nn){return("000000"+this.getHex(t).toString(16)).slice(-6)}getHSL(t,e=fe.workingColorSpace){fe.workingToColorSpace(Sn.copy(this),e);let n=Sn.r,s=Sn.g,r=Sn.b,o=Math.max(n,s,r),a=Math.min(n,s,r),c,l,h=(a+o)/2;if(a===o)c=0,l=0;else{let u=o-a;switch(l=h<=.5?u/(o+a):u/(2-o-a),o){case n:c=(s-r)/u+(s<r?6:0);break;case s:c=(r-n)/u+2;break;case r:c=(n-s)/u+4;break}c/=6}return t.h=c,t.s=l,t.l=h,t}getRGB(t,e=fe.workingColorSpace){return fe.workingToColorSpace(Sn.copy(this),e),t.r=Sn.r,t.g=Sn.g,t.b=Sn.b,t}getStyle(t=Nn){fe.workingToColorSpace(Sn.copy(this),t);let e=Sn.r,n=Sn.g,s=Sn.b;return t!==Nn?`color(${t} ${e.toFixed(3)} ${n.toFixed(3)} ${s.toFixed(3)})`:`rgb(${Math.round(e*255)},${Math.round(n*255)},${Math.round(s*255)})`}offsetHSL(t,e,n){return this.getHSL(fs),this.setHSL(fs.h+t,fs.s+e,fs.l+n)}add(t){return this.r+=t.r,this.g+=t.g,this.b+=t.b,this}addColors(t,e){return this.r=t.r+e.r,this.g=t.g+e.g,this.b=t.b+e.b,this}addScalar(t){return this.r+=t,this.g+=t,this.b+=t,this}sub(t){return this.r=Math.max(0,this.r-t.r),this.g=Math.max(0,this.g-t.g),this.b=Math.max(0,this.b-t.b),this}multiply(t){return this.r*=t.r,this.g*=t.g,this.b*=t.b,this}multiplyScalar(t){return this.r*=t,this.g*=t,this.b*=t,this}lerp(t,e){return this.r+=(t.r-this.r)*e,this.g+=(t.g-this.g)*e,this.b+=(t.b-this.b)*e,this}lerpColors(t,e,n){return this.r=t.r+(e.r-t.r)*n,this.g=t.g+(e.g-t.g)*n,this.b=t.b+(e.b-t.b)*n,this}lerpHSL(t,e){this.getHSL(fs),t.getHSL(Fa);let n=Co(fs.h,Fa.h,e),s=Co(fs.s,Fa.s,e),r=Co(fs.l,Fa.l,e);return this.setHSL(n,s,r),this}setFromVector3(t){return this.r=t.x,this.g=t.y,this.b=t.z,this}applyMatrix3(t){let e=this.r,n=this.g,s=this.b,r=t.elements;return this.r=r[0]*e+r[3]*n+r[6]*s,this.g=r[1]*e+r[4]*n+r[7]*s,this.b=r[2]*e+r[5]*n+r[8]*s,this}equals(t){return t.r===this.r&&t.g===this.g&&t.b===this.b}fromArray(t,e=0){return this.r=t[e],this.g=t[e+1],this.b=t[e+2],this}toArray(t=[],e=0){return t[e]=this.r,t[e+1]=this.g,t[e+2]=this.b,t}fromBufferAttribute(t,e){return this.r=t.getX(e),this.g=t.getY(e),this.b=t.getZ(e),this}toJSON(){return this.getHex()}*[Symbol.iterator](){yield this.r,yield this.g,yield this.b}},Sn=new jt;jt.NAMES=lm;var yx=0,Zs=class extends Pi{constructor(){super(),this.isMaterial=!0,Object.defineProperty(this,"id",{value:yx++}),this.uuid=Yi(),this.name="",this.type="Material",this.blending=qs,this.side=Zi,this.vertexColors=!1,this.opacity=1,this.transparent=!1,this.alphaHash=!1,this.blendSrc=Za,this.blendDst=Ja,this.blendEquation=_s,this.blendSrcAlpha=null,this.blendDstAlpha=null,this.blendEquationAlpha=null,this.blendColor=new jt(0,0,0),this.blendAlpha=0,this.depthFunc=Ys,this.depthTest=!0,this.depthWrite=!0,this.stencilWriteMask=255,this.stencilFunc=Wh,this.stencilRef=0,this.stencilFuncMask=255,this.stencilFail=Xs,this.stencilZFail=Xs,this.stencilZPass=Xs,this.stencilWrite=!1,this.clippingPlanes=null,this.clipIntersection=!1,this.clipShadows=!1,this.shadowSide=null,this.colorWrite=!0,this.precision=null,this.polygonOffset=!1,this.polygonOffsetFactor=0,this.polygonOffsetUnits=0,this.dithering=!1,this.alphaToCoverage=!1,this.premultipliedAlpha=!1,this.forceSinglePass=!1,this.allowOverride=!0,this.visible=!0,this.toneMapped=!0,this.userData={},this.version=0,this._alphaTest=0}get alphaTest(){return this._alphaTest}set alphaTest(t){this._alphaTest>0!=t>0&&this.version++,this._alphaTest=t}onBeforeRender(){}onBeforeCompile(){}customProgramCacheKey(){return this.onBeforeCompile.toString()}setValues(t){if(t!==void 0)for(let e in t){let n=t[e];if(n===void 0){console.warn(`THREE.Material: parameter '${e}' has value of undefined.`);continue}let s=this[e];if(s===void 0){console.warn(`THREE.Material: '${e}' is not a property of THREE.${this.type}.`);continue}s&&s.isColor?s.set(n):s&&s.isVector3&&n&&n.isVector3?s.copy(n):this[e]=n}}toJSON(t){let e=t===void 0||typeof t=="string";e&&(t={textures:{},images:{}});let n={metadata:{version:4.7,type:"Material",generator:"Material.toJSON"}};n.uuid=this.uuid,n.type=this.type,this.name!==""&&(n.name=this.name),this.color&&this.color.isColor&&(n.color=this.color.getHex()),this.roughness!==void 0&&(n.roughness=this.roughness),this.metalness!==void 0&&(n.metalness=this.metalness),this.sheen!==void 0&&(n.sheen=this.sheen),this.sheenColor&&this.sheenColor.isColor&&(n.sheenColor=this.sheenColor.getHex()),this.sheenRoughness!==void 0&&(n.sheenRoughness=this.sheenRoughness),this.emissive&&this.emissive.isColor&&(n.emissive=this.emissive.getHex()),this.emissiveIntensity!==void 0&&this.emissiveIntensity!==1&&(n.emissiveIntensity=this.emissiveIntensity),this.specular&&this.specular.isColor&&(n.specular=this.specular.getHex()),this.specularIntensity!==void 0&&(n.specularIntensity=this.specularIntensity),this.specularColor&&this.specularColor.isColor&&(n.specularColor=this.specularColor.getHex()),this.shininess!==void 0&&(n.shininess=this.shininess),this.clearcoat!==void 0&&(n.clearcoat=this.clearcoat),this.clearcoatRoughness!==void 0&&(n.clearcoatRoughness=this.clearcoatRoughness),this.clearcoatMap&&this.clearcoatMap.isTexture&&(n.clearcoatMap=this.clearcoatMap.toJSON(t).uuid),this.clearcoatRoughnessMap&&this.clearcoatRoughnessMap.isTexture&&(n.clearcoatRoughnessMap=this.clearcoatRoughnessMap.toJSON(t).uuid),this.clearcoatNormalMap&&this.clearcoatNormalMap.isTexture&&(n.clearcoatNormalMap=this.clearcoatNormalMap.toJSON(t).uuid,n.clearcoatNormalScale=this.clearcoatNormalScale.toArray()),this.sheenColorMap&&this.sheenColorMap.isTexture&&(n.sheenColorMap=this.sheenColorMap.toJSON(t).uuid),this.sheenRoughnessMap&&this.sheenRoughnessMap.isTexture&&(n.sheenRoughnessMap=this.sheenRoughnessMap.toJSON(t).uuid),this.dispersion!==void 0&&(n.dispersion=this.dispersion),this.iridescence!==void 0&&(n.iridescence=this.iridescence),this.iridescenceIOR!==void 0&&(n.iridescenceIOR=this.iridescenceIOR),this.iridescenceThicknessRange!==void 0&&(n.iridescenceThicknessRange=this.iridescenceThicknessRange),this.iridescenceMap&&this.iridescenceMap.isTexture&&(n.iridescenceMap=this.iridescenceMap.toJSON(t).uuid),this.iridescenceThicknessMap&&this.iridescenceThicknessMap.isTexture&&(n.iridescenceThicknessMap=this.iridescenceThicknessMap.toJSON(t).uuid),this.anisotropy!==void 0&&(n.anisotropy=this.anisotropy),this.anisotropyRotation!==void 0&&(n.anisotropyRotation=this.anisotropyRotation),this.anisotropyMap&&this.anisotropyMap.isTexture&&(n.anisotropyMap=this.anisotropyMap.toJSON(t).uuid),this.map&&this.map.isTexture&&(n.map=this.map.toJSON(t).uuid),this.matcap&&this.matcap.isTexture&&(n.matcap=this.matcap.toJSON(t).uuid),this.alphaMap&&this.alphaMap.isTexture&&(n.alphaMap=this.alphaMap.toJSON(t).uuid),this.lightMap&&this.lightMap.isTexture&&(n.lightMap=this.lightMap.toJSON(t).uuid,n.lightMapIntensity=this.lightMapIntensity),this.aoMap&&this.aoMap.isTexture&&(n.aoMap=this.aoMap.toJSON(t).uuid,n.aoMapIntensity=this.aoMapIntensity),this.bumpMap&&this.bumpMap.isTexture&&(n.bumpMap=this.bumpMap.toJSON(t).uuid,n.bumpScale=this.bumpScale),this.normalMap&&this.normalMap.isTexture&&(n.normalMap=this.normalMap.toJSON(t).uuid,n.normalMapType=this.normalMapType,n.normalScale=this.normalScale.toArray()),this.displacementMap&&this.displacementMap.isTexture&&(n.displacementMap=this.displacementMap.toJSON(t).uuid,n.displacementScale=this.displacementScale,n.displacementBias=this.displacementBias),this.roughnessMap&&this.roughnessMap.isTexture&&(n.roughnessMap=this.roughnessMap.toJSON(t).uuid),this.metalnessMap&&this.metalnessMap.isTexture&&(n.metalnessMap=this.metalnessMap.toJSON(t).uuid),this.emissiveMap&&this.emissiveMap.isTexture&&(n.emissiveMap=this.emissiveMap.toJSON(t).uuid),this.specularMap&&this.specularMap.isTexture&&(n.specularMap=this.specularMap.toJSON(t).uuid),this.specularIntensityMap&&this.specularIntensityMap.isTexture&&(n.specularIntensityMap=this.specularIntensityMap.toJSON(t).uuid),this.specularColorMap&&this.specularColorMap.isTexture&&(n.specularColorMap=this.specularColorMap.toJSON(t).uuid),this.envMap&&this.envMap.isTexture&&(n.envMap=this.envMap.toJSON(t).uuid,this.combine!==void 0&&(n.combine=this.combine)),this.envMapRotation!==void 0&&(n.envMapRotation=this.envMapRotation.toArray()),this.envMapIntensity!==void 0&&(n.envMapIntensity=this.envMapIntensity),this.reflectivity!==void 0&&(n.reflectivity=this.reflectivity),this.refractionRatio!==void 0&&(n.refractionRatio=this.refractionRatio),this.gradientMap&&this.gradientMap.isTexture&&(n.gradientMap=this.gradientMap.toJSON(t).uuid),this.transmission!==void 0&&(n.transmission=this.transmission),this.transmissionMap&&this.transmissionMap.isTexture&&(n.transmissionMap=this.transmissionMap.toJSON(t).uuid),this.thickness!==void 0&&(n.thickness=this.thickness),this.thicknessMap&&this.thicknessMap.isTexture&&(n.thicknessMap=this.thicknessMap.toJSON(t).uuid),this.attenuationDistance!==void 0&&this.attenuationDistance!==1/0&&(n.attenuationDistance=this.attenuationDistance),this.attenuationColor!==void 0&&(n.attenuationColor=this.attenuationColor.getHex()),this.size!==void 0&&(n.size=this.size),this.shadowSide!==null&&(n.shadowSide=this.shadowSide),this.sizeAttenuation!==void 0&&(n.sizeAttenuation=this.sizeAttenuation),this.blending!==qs&&(n.blending=this.blending),this.side!==Zi&&(n.side=this.side),this.vertexColors===!0&&(n.vertexColors=!0),this.opacity<1&&(n.opacity=this.opacity),this.transparent===!0&&(n.transparent=!0),this.blendSrc!==Za&&(n.blendSrc=this.blendSrc),this.blendDst!==Ja&&(n.blendDst=this.blendDst),this.blendEquation!==_s&&(n.blendEquation=this.blendEquation),this.blendSrcAlpha!==null&&(n.blendSrcAlpha=this.blendSrcAlpha),this.blendDstAlpha!==null&&(n.blendDstAlpha=this.blendDstAlpha),this.blendEquationAlpha!==null&&(n.blendEquationAlpha=this.blendEquationAlpha),this.blendColor&&this.blendColor.isColor&&(n.blendColor=this.blendColor.getHex()),this.blendAlpha!==0&&(n.blendAlpha=this.blendAlpha),this.depthFunc!==Ys&&(n.depthFunc=this.depthFunc),this.depthTest===!1&&(n.depthTest=this.depthTest),this.depthWrite===!1&&(n.depthWrite=this.depthWrite),this.colorWrite===!1&&(n.colorWrite=this.colorWrite),this.stencilWriteMask!==255&&(n.stencilWriteMask=this.stencilWriteMask),this.stencilFunc!==Wh&&(n.stencilFunc=this.stencilFunc),this.stencilRef!==0&&(n.stencilRef=this.stencilRef),this.stencilFuncMask!==255&&(n.stencilFuncMask=this.stencilFuncMask),this.stencilFail!==Xs&&(n.stencilFail=this.stencilFail),this.stencilZFail!==Xs&&(n.stencilZFail=this.stencilZFail),this.stencilZPass!==Xs&&(n.stencilZPass=this.stencilZPass),this.stencilWrite===!0&&(n.stencilWrite=this.stencilWrite),this.rotation!==void 0&&this.rotation!==0&&(n.rotation=this.rotation),this.polygonOffset===!0&&(n.polygonOffset=!0),this.polygonOffsetFactor!==0&&(n.polygonOffsetFactor=this.polygonOffsetFactor),this.polygonOffsetUnits!==0&&(n.polygonOffsetUnits=this.polygonOffsetUnits),this.linewidth!==void 0&&this.linewidth!==1&&(n.linewidth=this.linewidth),this.dashSize!==void 0&&(n.dashSize=this.dashSize),this.gapSize!==void 0&&(n.gapSize=this.gapSize),this.scale!==void 0&&(n.scale=this.scale),this.dithering===!0&&(n.dithering=!0),this.alphaTest>0&&(n.alphaTest=this.alphaTest),this.alphaHash===!0&&(n.alphaHash=!0),this.alphaToCoverage===!0&&(n.alphaToCoverage=!0),this.premultipliedAlpha===!0&&(n.premultipliedAlpha=!0),this.forceSinglePass===!0&&(n.forceSinglePass=!0),this.wireframe===!0&&(n.wireframe=!0),this.wireframeLinewidth>1&&(n.wireframeLinewidth=this.wireframeLinewidth),this.wireframeLinecap!=="round"&&(n.wireframeLinecap=this.wireframeLinecap),this.wireframeLinejoin!=="round"&&(n.wireframeLinejoin=this.wireframeLinejoin),this.flatShading===!0&&(n.flatShading=!0),this.visible===!1&&(n.visible=!1),this.toneMapped===!1&&(n.toneMapped=!1),this.fog===!1&&(n.fog=!1),Object.keys(this.userData).length>0&&(n.userData=this.userData);function s(r){let o=[];for(let a in r){let c=r[a];delete c.metadata,o.push(c)}return o}if(e){let r=s(t.textures),o=s(t.images);r.length>0&&(n.textures=r),o.length>0&&(n.images=o)}return n}clone(){return new this.constructor().copy(this)}copy(t){this.name=t.name,this.blending=t.blending,this.side=t.side,this.vertexColors=t.vertexColors,this.opacity=t.opacity,this.transparent=t.transparent,this.blendSrc=t.blendSrc,this.blendDst=t.blendDst,this.blendEquation=t.blendEquation,this.blendSrcAlpha=t.blendSrcAlpha,this.blendDstAlpha=t.blendDstAlpha,this.blendEquationAlpha=t.blendEquationAlpha,this.blendColor.copy(t.blendColor),this.blendAlpha=t.blendAlpha,this.depthFunc=t.depthFunc,this.depthTest=t.depthTest,this.depthWrite=t.depthWrite,this.stencilWriteMask=t.stencilWriteMask,this.stencilFunc=t.stencilFunc,this.stencilRef=t.stencilRef,this.stencilFuncMask=t.stencilFuncMask,this.stencilFail=t.stencilFail,this.stencilZFail=t.stencilZFail,this.stencilZPass=t.stencilZPass,this.stencilWrite=t.stencilWrite;let e=t.clippingPlanes,n=null;if(e!==null){let s=e.length;n=new Array(s);for(let r=0;r!==s;++r)n[r]=e[r].clone()}return this.clippingPlanes=n,this.clipIntersection=t.clipIntersection,this.clipShadows=t.clipShadows,this.shadowSide=t.shadowSide,this.colorWrite=t.colorWrite,this.precision=t.precision,this.polygonOffset=t.polygonOffset,this.polygonOffsetFactor=t.polygonOffsetFactor,this.polygonOffsetUnits=t.polygonOffsetUnits,this.dithering=t.dithering,this.alphaTest=t.alphaTest,this.alphaHash=t.alphaHash,this.alphaToCoverage=t.alphaToCoverage,this.premultipliedAlpha=t.premultipliedAlpha,this.forceSinglePass=t.forceSinglePass,this.visible=t.visible,this.toneMapped=t.toneMapped,this.userData=JSON.parse(JSON.stringify(t.userData)),this}dispose(){this.dispatchEvent({type:"dispose"})}set needsUpdate(t){t===!0&&this.version++}},Js=class extends Zs{constructor(t){super(),this.isMeshBasicMaterial=!0,this.type="MeshBasicMaterial",this.color=new jt(16777215),this.map=null,this.lightMap=null,this.lightMapIntensity=1,this.aoMap=null,this.aoMapIntensity=1,this.specularMap=null,this.alphaMap=null,this.envMap=null,this.envMapRotation=new Li,this.combine=Kh,this.reflectivity=1,this.refractionRatio=.98,this.wireframe=!1,this.wireframeLinewidth=1,this.wireframeLinecap="round",this.wireframeLinejoin="round",this.fog=!0,this.setValues(t)}copy(t){return super.copy(t),this.color.copy(t.color),this.map=t.map,this.lightMap=t.lightMap,this.lightMapIntensity=t.lightMapIntensity,this.aoMap=t.aoMap,this.aoMapIntensity=t.aoMapIntensity,this.specularMap=t.specularMap,this.alphaMap=t.alphaMap,this.envMap=t.envMap,this.envMapRotation.copy(t.envMapRotation),this.combine=t.combine,this.reflectivity=t.reflectivity,this.refractionRatio=t.refractionRatio,this.wireframe=t.wireframe,this.wireframeLinewidth=t.wireframeLinewidth,this.wireframeLinecap=t.wireframeLinecap,this.wireframeLinejoin=t.wireframeLinejoin,this.fog=t.fog,this}};var je=new H,Oa=new Jt,vx=0,Oe=class{constructor(t,e,n=!1){if(Array.isArray(t))throw new TypeError("THREE.BufferAttribute: array should be a Typed Array.");this.isBufferAttribute=!0,Object.defineProperty(this,"id",{value:vx++}),this.name="",this.array=t,this.itemSize=e,this.count=t!==void 0?t.length/e:0,this.normalized=n,this.usage=tl,this.updateRanges=[],this.gpuType=bi,this.version=0}onUploadCallback(){}set needsUpdate(t){t===!0&&this.version++}setUsage(t){return this.usage=t,this}addUpdateRange(t,e){this.updateRanges.push({start:t,count:e})}clearUpdateRanges(){this.updateRanges.length=0}copy(t){return this.name=t.name,this.array=new t.array.constructor(t.array),this.itemSize=t.itemSize,this.count=t.count,this.normalized=t.normalized,this.usage=t.usage,this.gpuType=t.gpuType,this}copyAt(t,e,n){t*=this.itemSize,n*=e.itemSize;for(let s=0,r=this.itemSize;s<r;s++)this.array[t+s]=e.array[n+s];return this}copyArray(t){return this.array.set(t),this}applyMatrix3(t){if(this.itemSize===2)for(let e=0,n=this.count;e<n;e++)Oa.fromBufferAttribute(this,e),Oa.applyMatrix3(t),this.setXY(e,Oa.x,Oa.y);else if(this.itemSize===3)for(let e=0,n=this.count;e<n;e++)je.fromBufferAttribute(this,e),je.applyMatrix3(t),this.setXYZ(e,je.x,je.y,je.z);return this}applyMatrix4(t){for(let e=0,n=this.count;e<n;e++)je.fromBufferAttribute(this,e),je.applyMatrix4(t),this.setXYZ(e,je.x,je.y,je.z);return this}applyNormalMatrix(t){for(let e=0,n=this.count;e<n;e++)je.fromBufferAttribute(this,e),je.applyNormalMatrix(t),this.setXYZ(e,je.x,je.y,je.z);return this}transformDirection(t){for(let e=0,n=this.count;e<n;e++)je.fromBufferAttribute(this,e),je.transformDirection(t),this.setXYZ(e,je.x,je.y,je.z);return this}set(t,e=0){return this.array.set(t,e),this}getComponent(t,e){let n=this.array[t*this.itemSize+e];return this.normalized&&(n=yi(n,this.array)),n}setComponent(t,e,n){return this.normalized&&(n=we(n,this.array)),this.array[t*this.itemSize+e]=n,this}getX(t){let e=this.array[t*this.itemSize];return this.normalized&&(e=yi(e,this.array)),e}setX(t,e){return this.normalized&&(e=we(e,this.array)),this.array[t*this.itemSize]=e,this}getY(t){let e=this.array[t*this.itemSize+1];return this.normalized&&(e=yi(e,this.array)),e}setY(t,e){return this.normalized&&(e=we(e,this.array)),this.array[t*this.itemSize+1]=e,this}getZ(t){let e=this.array[t*this.itemSize+2];return this.normalized&&(e=yi(e,this.array)),e}setZ(t,e){return this.normalized&&(e=we(e,this.array)),this.array[t*this.itemSize+2]=e,this}getW(t){let e=this.array[t*this.itemSize+3];return this.normalized&&(e=yi(e,this.array)),e}setW(t,e){return this.normalized&&(e=we(e,this.array)),this.array[t*this.itemSize+3]=e,this}setXY(t,e,n){return t*=this.itemSize,this.normalized&&(e=we(e,this.array),n=we(n,this.array)),this.array[t+0]=e,this.array[t+1]=n,this}setXYZ(t,e,n,s){return t*=this.itemSize,this.normalized&&(e=we(e,this.array),n=we(n,this.array),s=we(s,this.array)),this.array[t+0]=e,this.array[t+1]=n,this.array[t+2]=s,this}setXYZW(t,e,n,s,r){return t*=this.itemSize,this.normalized&&(e=we(e,this.array),n=we(n,this.array),s=we(s,this.array),r=we(r,this.array)),this.array[t+0]=e,this.array[t+1]=n,this.array[t+2]=s,this.array[t+3]=r,this}onUpload(t){return this.onUploadCallback=t,this}clone(){return new this.constructor(this.array,this.itemSize).copy(this)}toJSON(){let t={itemSize:this.itemSize,type:this.array.constructor.name,array:Array.from(this.array),normalized:this.normalized};return this.name!==""&&(t.name=this.name),this.usage!==tl&&(t.usage=this.usage),t}};var Fo=class extends Oe{constructor(t,e,n){super(new Uint16Array(t),e,n)}};var Oo=class extends Oe{constructor(t,e,n){super(new Uint32Array(t),e,n)}};var qe=class extends Oe{constructor(t,e,n){super(new Float32Array(t),e,n)}},Mx=0,si=new Re,Bh=new ai,Fr=new H,Kn=new oi,Eo=new oi,gn=new H,Qe=class i extends Pi{constructor(){super(),this.isBufferGeometry=!0,Object.defineProperty(this,"id",{value:Mx++}),this.uuid=Yi(),this.name="",this.type="BufferGeometry",this.index=null,this.indirect=null,this.attributes={},this.morphAttributes={},this.morphTargetsRelative=!1,this.groups=[],this.boundingBox=null,this.boundingSphere=null,this.drawRange={start:0,count:1/0},this.userData={}}getIndex(){return this.index}setIndex(t){return Array.isArray(t)?this.index=new(hu(t)?Oo:Fo)(t,1):this.index=t,this}setIndirect(t){return this.indirect=t,this}getIndirect(){return this.indirect}getAttribute(t){return this.attributes[t]}setAttribute(t,e){return this.attributes[t]=e,this}deleteAttribute(t){return delete this.attributes[t],this}hasAttribute(t){return this.attributes[t]!==void 0}addGroup(t,e,n=0){this.groups.push({start:t,count:e,materialIndex:n})}clearGroups(){this.groups=[]}setDrawRange(t,e){this.drawRange.start=t,this.drawRange.count=e}applyMatrix4(t){let e=this.attributes.position;e!==void 0&&(e.applyMatrix4(t),e.needsUpdate=!0);let n=this.attributes.normal;if(n!==void 0){let r=new re().getNormalMatrix(t);n.applyNormalMatrix(r),n.needsUpdate=!0}let s=this.attributes.tangent;return s!==void 0&&(s.transformDirection(t),s.needsUpdate=!0),this.boundingBox!==null&&this.computeBoundingBox(),this.boundingSphere!==null&&this.computeBoundingSphere(),this}applyQuaternion(t){return si.makeRotationFromQuaternion(t),this.applyMatrix4(si),this}rotateX(t){return si.makeRotationX(t),this.applyMatrix4(si),this}rotateY(t){return si.makeRotationY(t),this.applyMatrix4(si),this}rotateZ(t){return si.makeRotationZ(t),this.applyMatrix4(si),this}translate(t,e,n){return si.makeTranslation(t,e,n),this.applyMatrix4(si),this}scale(t,e,n){return si.makeScale(t,e,n),this.applyMatrix4(si),this}lookAt(t){return Bh.lookAt(t),Bh.updateMatrix(),this.applyMatrix4(Bh.matrix),this}center(){return this.computeBoundingBox(),this.boundingBox.getCenter(Fr).negate(),this.translate(Fr.x,Fr.y,Fr.z),this}setFromPoints(t){let e=this.getAttribute("position");if(e===void 0){let n=[];for(let s=0,r=t.length;s<r;s++){let o=t[s];n.push(o.x,o.y,o.z||0)}this.setAttribute("position",new qe(n,3))}else{let n=Math.min(t.length,e.count);for(let s=0;s<n;s++){let r=t[s];e.setXYZ(s,r.x,r.y,r.z||0)}t.length>e.count&&console.warn("THREE.BufferGeometry: Buffer size too small for points data. Use .dispose() and create a new geometry."),e.needsUpdate=!0}return this}computeBoundingBox(){this.boundingBox===null&&(this.boundingBox=new oi);let t=this.attributes.position,e=this.morphAttributes.position;if(t&&t.isGLBufferAttribute){console.error("THREE.BufferGeometry.computeBoundingBox(): GLBufferAttribute requires a manual bounding box.",this),this.boundingBox.set(new H(-1/0,-1/0,-1/0),new H(1/0,1/0,1/0));return}if(t!==void 0){if(this.boundingBox.setFromBufferAttribute(t),e)for(let n=0,s=e.length;n<s;n++){let r=e[n];Kn.setFromBufferAttribute(r),this.morphTargetsRelative?(gn.addVectors(this.boundingBox.min,Kn.min),this.boundingBox.expandByPoint(gn),gn.addVectors(this.boundingBox.max,Kn.max),this.boundingBox.expandByPoint(gn)):(this.boundingBox.expandByPoint(Kn.min),this.boundingBox.expandByPoint(Kn.max))}}else this.boundingBox.makeEmpty();(isNaN(this.boundingBox.min.x)||isNaN(this.boundingBox.min.y)||isNaN(this.boundingBox.min.z))&&console.error('THREE.BufferGeometry.computeBoundingBox(): Computed min/max have NaN values. The "position" attribute is likely to have NaN values.',this)}computeBoundingSphere(){this.boundingSphere===null&&(this.boundingSphere=new xs);let t=this.attributes.position,e=this.morphAttributes.position;if(t&&t.isGLBufferAttribute){console.error("THREE.BufferGeometry.computeBoundingSphere(): GLBufferAttribute requires a manual bounding sphere.",this),this.boundingSphere.set(new H,1/0);return}if(t){let n=this.boundingSphere.center;if(Kn.setFromBufferAttribute(t),e)for(let r=0,o=e.length;r<o;r++){let a=e[r];Eo.setFromBufferAttribute(a),this.morphTargetsRelative?(gn.addVectors(Kn.min,Eo.min),Kn.expandByPoint(gn),gn.addVectors(Kn.max,Eo.max),Kn.expandByPoint(gn)):(Kn.expandByPoint(Eo.min),Kn.expandByPoint(Eo.max))}Kn.getCenter(n);let s=0;for(let r=0,o=t.count;r<o;r++)gn.fromBufferAttribute(t,r),s=Math.max(s,n.distanceToSquared(gn));if(e)for(let r=0,o=e.length;r<o;r++){let a=e[r],c=this.morphTargetsRelative;for(let l=0,h=a.count;l<h;l++)gn.fromBufferAttribute(a,l),c&&(Fr.fromBufferAttribute(t,l),gn.add(Fr)),s=Math.max(s,n.distanceToSquared(gn))}this.boundingSphere.radius=Math.sqrt(s),isNaN(this.boundingSphere.radius)&&console.error('THREE.BufferGeometry.computeBoundingSphere(): Computed radius is NaN. The "position" attribute is likely to have NaN values.',this)}}computeTangents(){let t=this.index,e=this.attributes;if(t===null||e.position===void 0||e.normal===void 0||e.uv===void 0){console.error("THREE.BufferGeometry: .computeTangents() failed. Missing required attributes (index, position, normal or uv)");return}let n=e.position,s=e.normal,r=e.uv;this.hasAttribute("tangent")===!1&&this.setAttribute("tangent",new Oe(new Float32Array(4*n.count),4));let o=this.getAttribute("tangent"),a=[],c=[];for(let U=0;U<n.count;U++)a[U]=new H,c[U]=new H;let l=new H,h=new H,u=new H,d=new Jt,f=new Jt,g=new Jt,x=new H,m=new H;function p(U,S,b){l.fromBufferAttribute(n,U),h.fromBufferAttribute(n,S),u.fromBufferAttribute(n,b),d.fromBufferAttribute(r,U),f.fromBufferAttribute(r,S),g.fromBufferAttribute(r,b),h.sub(l),u.sub(l),f.sub(d),g.sub(d);let P=1/(f.x*g.y-g.x*f.y);isFinite(P)&&(x.copy(h).multiplyScalar(g.y).addScaledVector(u,-f.y).multiplyScalar(P),m.copy(u).multiplyScalar(f.x).addScaledVector(h,-g.x).multiplyScalar(P),a[U].add(x),a[S].add(x),a[b].add(x),c[U].add(m),c[S].add(m),c[b].add(m))}let w=this.groups;w.length===0&&(w=[{start:0,count:t.count}]);for(let U=0,S=w.length;U<S;++U){let b=w[U],P=b.start,O=b.count;for(let z=P,W=P+O;z<W;z+=3)p(t.getX(z+0),t.getX(z+1),t.getX(z+2))}let E=new H,v=new H,C=new H,A=new H;function D(U){C.fromBufferAttribute(s,U),A.copy(C);let S=a[U];E.copy(S),E.sub(C.multiplyScalar(C.dot(S))).normalize(),v.crossVectors(A,S);let P=v.dot(c[U])<0?-1:1;o.setXYZW(U,E.x,E.y,E.z,P)}for(let U=0,S=w.length;U<S;++U){let b=w[U],P=b.start,O=b.count;for(let z=P,W=P+O;z<W;z+=3)D(t.getX(z+0)),D(t.getX(z+1)),D(t.getX(z+2))}}computeVertexNormals(){let t=this.index,e=this.getAttribute("position");if(e!==void 0){let n=this.getAttribute("normal");if(n===void 0)n=new Oe(new Float32Array(e.count*3),3),this.setAttribute("normal",n);else for(let d=0,f=n.count;d<f;d++)n.setXYZ(d,0,0,0);let s=new H,r=new H,o=new H,a=new H,c=new H,l=new H,h=new H,u=new H;if(t)for(let d=0,f=t.count;d<f;d+=3){let g=t.getX(d+0),x=t.getX(d+1),m=t.getX(d+2);s.fromBufferAttribute(e,g),r.fromBufferAttribute(e,x),o.fromBufferAttribute(e,m),h.subVectors(o,r),u.subVectors(s,r),h.cross(u),a.fromBufferAttribute(n,g),c.fromBufferAttribute(n,x),l.fromBufferAttribute(n,m),a.add(h),c.add(h),l.add(h),n.setXYZ(g,a.x,a.y,a.z),n.setXYZ(x,c.x,c.y,c.z),n.setXYZ(m,l.x,l.y,l.z)}else for(let d=0,f=e.count;d<f;d+=3)s.fromBufferAttribute(e,d+0),r.fromBufferAttribute(e,d+1),o.fromBufferAttribute(e,d+2),h.subVectors(o,r),u.subVectors(s,r),h.cross(u),n.setXYZ(d+0,h.x,h.y,h.z),n.setXYZ(d+1,h.x,h.y,h.z),n.setXYZ(d+2,h.x,h.y,h.z);this.normalizeNormals(),n.needsUpdate=!0}}normalizeNormals(){let t=this.attributes.normal;for(let e=0,n=t.count;e<n;e++)gn.fromBufferAttribute(t,e),gn.normalize(),t.setXYZ(e,gn.x,gn.y,gn.z)}toNonIndexed(){function t(a,c){let l=a.array,h=a.itemSize,u=a.normalized,d=new l.constructor(c.length*h),f=0,g=0;for(let x=0,m=c.length;x<m;x++){a.isInterleavedBufferAttribute?f=c[x]*a.data.stride+a.offset:f=c[x]*h;for(let p=0;p<h;p++)d[g++]=l[f++]}return new Oe(d,h,u)}if(this.index===null)return console.warn("THREE.BufferGeometry.toNonIndexed(): BufferGeometry is already non-indexed."),this;let e=new i,n=this.index.array,s=this.attributes;for(let a in s){let c=s[a],l=t(c,n);e.setAttribute(a,l)}let r=this.morphAttributes;for(let a in r){let c=[],l=r[a];for(let h=0,u=l.length;h<u;h++){let d=l[h],f=t(d,n);c.push(f)}e.morphAttributes[a]=c}e.morphTargetsRelative=this.morphTargetsRelative;let o=this.groups;for(let a=0,c=o.length;a<c;a++){let l=o[a];e.addGroup(l.start,l.count,l.materialIndex)}return e}toJSON(){let t={metadata:{version:4.7,type:"BufferGeometry",generator:"BufferGeometry.toJSON"}};if(t.uuid=this.uuid,t.type=this.type,this.name!==""&&(t.name=this.name),Object.keys(this.userData).length>0&&(t.userData=this.userData),this.parameters!==void 0){let c=this.parameters;for(let l in c)c[l]!==void 0&&(t[l]=c[l]);return t}t.data={attributes:{}};let e=this.index;e!==null&&(t.data.index={type:e.array.constructor.name,array:Array.prototype.slice.call(e.array)});let n=this.attributes;for(let c in n){let l=n[c];t.data.attributes[c]=l.toJSON(t.data)}let s={},r=!1;for(let c in this.morphAttributes){let l=this.morphAttributes[c],h=[];for(let u=0,d=l.length;u<d;u++){let f=l[u];h.push(f.toJSON(t.data))}h.length>0&&(s[c]=h,r=!0)}r&&(t.data.morphAttributes=s,t.data.morphTargetsRelative=this.morphTargetsRelative);let o=this.groups;o.length>0&&(t.data.groups=JSON.parse(JSON.stringify(o)));let a=this.boundingSphere;return a!==null&&(t.data.boundingSphere=a.toJSON()),t}clone(){return new this.constructor().copy(this)}copy(t){this.index=null,this.attributes={},this.morphAttributes={},this.groups=[],this.boundingBox=null,this.boundingSphere=null;let e={};this.name=t.name;let n=t.index;n!==null&&this.setIndex(n.clone());let s=t.attributes;for(let l in s){let h=s[l];this.setAttribute(l,h.clone(e))}let r=t.morphAttributes;for(let l in r){let h=[],u=r[l];for(let d=0,f=u.length;d<f;d++)h.push(u[d].clone(e));this.morphAttributes[l]=h}this.morphTargetsRelative=t.morphTargetsRelative;let o=t.groups;for(let l=0,h=o.length;l<h;l++){let u=o[l];this.addGroup(u.start,u.count,u.materialIndex)}let a=t.boundingBox;a!==null&&(this.boundingBox=a.clone());let c=t.boundingSphere;return c!==null&&(this.boundingSphere=c.clone()),this.drawRange.start=t.drawRange.start,this.drawRange.count=t.drawRange.count,this.userData=t.userData,this}dispose(){this.dispatchEvent({type:"dispose"})}},up=new Re,Gs=new Xr,Ba=new xs,dp=new H,ka=new H,za=new H,Va=new H,kh=new H,Ha=new H,fp=new H,Ga=new H,tn=class extends ai{constructor(t=new Qe,e=new Js){super(),this.isMesh=!0,this.type="Mesh",this.geometry=t,this.material=e,this.morphTargetDictionary=void 0,this.morphTargetInfluences=void 0,this.count=1,this.updateMorphTargets()}copy(t,e){return super.copy(t,e),t.morphTargetInfluences!==void 0&&(this.morphTargetInfluences=t.morphTargetInfluences.slice()),t.morphTargetDictionary!==void 0&&(this.morphTargetDictionary=Object.assign({},t.morphTargetDictionary)),this.material=Array.isArray(t.material)?t.material.slice():t.material,this.geometry=t.geometry,this}updateMorphTargets(){let e=this.geometry.morphAttributes,n=Object.keys(e);if(n.length>0){let s=e[n[0]];if(s!==void 0){this.morphTargetInfluences=[],this.morphTargetDictionary={};for(let r=0,o=s.length;r<o;r++){let a=s[r].name||String(r);this.morphTargetInfluences.push(0),this.morphTargetDictionary[a]=r}}}}getVertexPosition(t,e){let n=this.geometry,s=n.attributes.position,r=n.morphAttributes.position,o=n.morphTargetsRelative;e.fromBufferAttribute(s,t);let a=this.morphTargetInfluences;if(r&&a){Ha.set(0,0,0);for(let c=0,l=r.length;c<l;c++){let h=a[c],u=r[c];h!==0&&(kh.fromBufferAttribute(u,t),o?Ha.addScaledVector(kh,h):Ha.addScaledVector(kh.sub(e),h))}e.add(Ha)}return e}raycast(t,e){let n=this.geometry,s=this.material,r=this.matrixWorld;s!==void 0&&(n.boundingSphere===null&&n.computeBoundingSphere(),Ba.copy(n.boundingSphere),Ba.applyMatrix4(r),Gs.copy(t.ray).recast(t.near),!(Ba.containsPoint(Gs.origin)===!1&&(Gs.intersectSphere(Ba,dp)===null||Gs.origin.distanceToSquared(dp)>(t.far-t.near)**2))&&(up.copy(r).invert(),Gs.copy(t.ray).applyMatrix4(up),!(n.boundingBox!==null&&Gs.intersectsBox(n.boundingBox)===!1)&&this._computeIntersections(t,e,Gs)))}_computeIntersections(t,e,n){let s,r=this.geometry,o=this.material,a=r.index,c=r.attributes.position,l=r.attributes.uv,h=r.attributes.uv1,u=r.attributes.normal,d=r.groups,f=r.drawRange;if(a!==null)if(Array.isArray(o))for(let g=0,x=d.length;g<x;g++){let m=d[g],p=o[m.materialIndex],w=Math.max(m.start,f.start),E=Math.min(a.count,Math.min(m.start+m.count,f.start+f.count));for(let v=w,C=E;v<C;v+=3){let A=a.getX(v),D=a.getX(v+1),U=a.getX(v+2);s=Wa(this,p,t,n,l,h,u,A,D,U),s&&(s.faceIndex=Math.floor(v/3),s.face.materialIndex=m.materialIndex,e.push(s))}}else{let g=Math.max(0,f.start),x=Math.min(a.count,f.start+f.count);for(let m=g,p=x;m<p;m+=3){let w=a.getX(m),E=a.getX(m+1),v=a.getX(m+2);s=Wa(this,o,t,n,l,h,u,w,E,v),s&&(s.faceIndex=Math.floor(m/3),e.push(s))}}else if(c!==void 0)if(Array.isArray(o))for(let g=0,x=d.length;g<x;g++){let m=d[g],p=o[m.materialIndex],w=Math.max(m.start,f.start),E=Math.min(c.count,Math.min(m.start+m.count,f.start+f.count));for(let v=w,C=E;v<C;v+=3){let A=v,D=v+1,U=v+2;s=Wa(this,p,t,n,l,h,u,A,D,U),s&&(s.faceIndex=Math.floor(v/3),s.face.materialIndex=m.materialIndex,e.push(s))}}else{let g=Math.max(0,f.start),x=Math.min(c.count,f.start+f.count);for(let m=g,p=x;m<p;m+=3){let w=m,E=m+1,v=m+2;s=Wa(this,o,t,n,l,h,u,w,E,v),s&&(s.faceIndex=Math.floor(m/3),e.push(s))}}}};function bx(i,t,e,n,s,r,o,a){let c;if(t.side===Fn?c=n.intersectTriangle(o,r,s,!0,a):c=n.intersectTriangle(s,r,o,t.side===Zi,a),c===null)return null;Ga.copy(a),Ga.applyMatrix4(i.matrixWorld);let l=e.ray.origin.distanceTo(Ga);return l<e.near||l>e.far?null:{distance:l,point:Ga.clone(),object:i}}function Wa(i,t,e,n,s,r,o,a,c,l){i.getVertexPosition(a,ka),i.getVertexPosition(c,za),i.getVertexPosition(l,Va);let h=bx(i,t,e,n,ka,za,Va,fp);if(h){let u=new H;ms.getBarycoord(fp,ka,za,Va,u),s&&(h.uv=ms.getInterpolatedAttribute(s,a,c,l,u,new Jt)),r&&(h.uv1=ms.getInterpolatedAttribute(r,a,c,l,u,new Jt)),o&&(h.normal=ms.getInterpolatedAttribute(o,a,c,l,u,new H),h.normal.dot(n.direction)>0&&h.normal.multiplyScalar(-1));let d={a,b:c,c:l,normal:new H,materialIndex:0};ms.getNormal(ka,za,Va,d.normal),h.face=d,h.barycoord=u}return h}var ys=class i extends Qe{constructor(t=1,e=1,n=1,s=1,r=1,o=1){super(),this.type="BoxGeometry",this.parameters={width:t,height:e,depth:n,widthSegments:s,heightSegments:r,depthSegments:o};let a=this;s=Math.floor(s),r=Math.floor(r),o=Math.floor(o);let c=[],l=[],h=[],u=[],d=0,f=0;g("z","y","x",-1,-1,n,e,t,o,r,0),g("z","y","x",1,-1,n,e,-t,o,r,1),g("x","z","y",1,1,t,n,e,s,o,2),g("x","z","y",1,-1,t,n,-e,s,o,3),g("x","y","z",1,-1,t,e,n,s,r,4),g("x","y","z",-1,-1,t,e,-n,s,r,5),this.setIndex(c),this.setAttribute("position",new qe(l,3)),this.setAttribute("normal",new qe(h,3)),this.setAttribute("uv",new qe(u,2));function g(x,m,p,w,E,v,C,A,D,U,S){let b=v/D,P=C/U,O=v/2,z=C/2,W=A/2,X=D+1,Y=U+1,j=0,K=0,at=new H;for(let lt=0;lt<Y;lt++){let xt=lt*P-z;for(let Mt=0;Mt<X;Mt++){let _t=Mt*b-O;at[x]=_t*w,at[m]=xt*E,at[p]=W,l.push(at.x,at.y,at.z),at[x]=0,at[m]=0,at[p]=A>0?1:-1,h.push(at.x,at.y,at.z),u.push(Mt/D),u.push(1-lt/U),j+=1}}for(let lt=0;lt<U;lt++)for(let xt=0;xt<D;xt++){let Mt=d+xt+X*lt,_t=d+xt+X*(lt+1),ie=d+(xt+1)+X*(lt+1),Qt=d+(xt+1)+X*lt;c.push(Mt,_t,Qt),c.push(_t,ie,Qt),K+=6}a.addGroup(f,K,S),f+=K,d+=j}}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.width,t.height,t.depth,t.widthSegments,t.heightSegments,t.depthSegments)}};function nr(i){let t={};for(let e in i){t[e]={};for(let n in i[e]){let s=i[e][n];s&&(s.isColor||s.isMatrix3||s.isMatrix4||s.isVector2||s.isVector3||s.isVector4||s.isTexture||s.isQuaternion)?s.isRenderTargetTexture?(console.warn("UniformsUtils: Textures of render targets cannot be cloned via cloneUniforms() or mergeUniforms()."),t[e][n]=null):t[e][n]=s.clone():Array.isArray(s)?t[e][n]=s.slice():t[e][n]=s}}return t}function En(i){let t={};for(let e=0;e<i.length;e++){let n=nr(i[e]);for(let s in n)t[s]=n[s]}return t}function Sx(i){let t=[];for(let e=0;e<i.length;e++)t.push(i[e].clone());return t}function uu(i){let t=i.getRenderTarget();return t===null?i.outputColorSpace:t.isXRRenderTarget===!0?t.texture.colorSpace:fe.workingColorSpace}var cm={clone:nr,merge:En},wx=`void main() {
	gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 );
}`,Ex=`void main() {
	gl_FragColor = vec4( 1.0, 0.0, 0.0, 1.0 );
}`,on=class extends Zs{constructor(t){super(),this.isShaderMaterial=!0,this.type="ShaderMaterial",this.defines={},this.uniforms={},this.uniformsGroups=[],this.vertexShader=wx,this.fragmentShader=Ex,this.linewidth=1,this.wireframe=!1,this.wireframeLinewidth=1,this.fog=!1,this.lights=!1,this.clipping=!1,this.forceSinglePass=!0,this.extensions={clipCullDistance:!1,multiDraw:!1},this.defaultAttributeValues={color:[1,1,1],uv:[0,0],uv1:[0,0]},this.index0AttributeName=void 0,this.uniformsNeedUpdate=!1,this.glslVersion=null,t!==void 0&&this.setValues(t)}copy(t){return super.copy(t),this.fragmentShader=t.fragmentShader,this.vertexShader=t.vertexShader,this.uniforms=nr(t.uniforms),this.uniformsGroups=Sx(t.uniformsGroups),this.defines=Object.assign({},t.defines),this.wireframe=t.wireframe,this.wireframeLinewidth=t.wireframeLinewidth,this.fog=t.fog,this.lights=t.lights,this.clipping=t.clipping,this.extensions=Object.assign({},t.extensions),this.glslVersion=t.glslVersion,this}toJSON(t){let e=super.toJSON(t);e.glslVersion=this.glslVersion,e.uniforms={};for(let s in this.uniforms){let o=this.uniforms[s].value;o&&o.isTexture?e.uniforms[s]={type:"t",value:o.toJSON(t).uuid}:o&&o.isColor?e.uniforms[s]={type:"c",value:o.getHex()}:o&&o.isVector2?e.uniforms[s]={type:"v2",value:o.toArray()}:o&&o.isVector3?e.uniforms[s]={type:"v3",value:o.toArray()}:o&&o.isVector4?e.uniforms[s]={type:"v4",value:o.toArray()}:o&&o.isMatrix3?e.uniforms[s]={type:"m3",value:o.toArray()}:o&&o.isMatrix4?e.uniforms[s]={type:"m4",value:o.toArray()}:e.uniforms[s]={value:o}}Object.keys(this.defines).length>0&&(e.defines=this.defines),e.vertexShader=this.vertexShader,e.fragmentShader=this.fragmentShader,e.lights=this.lights,e.clipping=this.clipping;let n={};for(let s in this.extensions)this.extensions[s]===!0&&(n[s]=!0);return Object.keys(n).length>0&&(e.extensions=n),e}},Bo=class extends ai{constructor(){super(),this.isCamera=!0,this.type="Camera",this.matrixWorldInverse=new Re,this.projectionMatrix=new Re,this.projectionMatrixInverse=new Re,this.coordinateSystem=vi,this._reversedDepth=!1}get reversedDepth(){return this._reversedDepth}copy(t,e){return super.copy(t,e),this.matrixWorldInverse.copy(t.matrixWorldInverse),this.projectionMatrix.copy(t.projectionMatrix),this.projectionMatrixInverse.copy(t.projectionMatrixInverse),this.coordinateSystem=t.coordinateSystem,this}getWorldDirection(t){return super.getWorldDirection(t).negate()}updateMatrixWorld(t){super.updateMatrixWorld(t),this.matrixWorldInverse.copy(this.matrixWorld).invert()}updateWorldMatrix(t,e){super.updateWorldMatrix(t,e),this.matrixWorldInverse.copy(this.matrixWorld).invert()}clone(){return new this.constructor().copy(this)}},ps=new H,pp=new Jt,mp=new Jt,wn=class extends Bo{constructor(t=50,e=1,n=.1,s=2e3){super(),this.isPerspectiveCamera=!0,this.type="PerspectiveCamera",this.fov=t,this.zoom=1,this.near=n,this.far=s,this.focus=10,this.aspect=e,this.view=null,this.filmGauge=35,this.filmOffset=0,this.updateProjectionMatrix()}copy(t,e){return super.copy(t,e),this.fov=t.fov,this.zoom=t.zoom,this.near=t.near,this.far=t.far,this.focus=t.focus,this.aspect=t.aspect,this.view=t.view===null?null:Object.assign({},t.view),this.filmGauge=t.filmGauge,this.filmOffset=t.filmOffset,this}setFocalLength(t){let e=.5*this.getFilmHeight()/t;this.fov=Hr*2*Math.atan(e),this.updateProjectionMatrix()}getFocalLength(){let t=Math.tan(Ro*.5*this.fov);return .5*this.getFilmHeight()/t}getEffectiveFOV(){return Hr*2*Math.atan(Math.tan(Ro*.5*this.fov)/this.zoom)}getFilmWidth(){return this.filmGauge*Math.min(this.aspect,1)}getFilmHeight(){return this.filmGauge/Math.max(this.aspect,1)}getViewBounds(t,e,n){ps.set(-1,-1,.5).applyMatrix4(this.projectionMatrixInverse),e.set(ps.x,ps.y).multiplyScalar(-t/ps.z),ps.set(1,1,.5).applyMatrix4(this.projectionMatrixInverse),n.set(ps.x,ps.y).multiplyScalar(-t/ps.z)}getViewSize(t,e){return this.getViewBounds(t,pp,mp),e.subVectors(mp,pp)}setViewOffset(t,e,n,s,r,o){this.aspect=t/e,this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=t,this.view.fullHeight=e,this.view.offsetX=n,this.view.offsetY=s,this.view.width=r,this.view.height=o,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let t=this.near,e=t*Math.tan(Ro*.5*this.fov)/this.zoom,n=2*e,s=this.aspect*n,r=-.5*s,o=this.view;if(this.view!==null&&this.view.enabled){let c=o.fullWidth,l=o.fullHeight;r+=o.offsetX*s/c,e-=o.offsetY*n/l,s*=o.width/c,n*=o.height/l}let a=this.filmOffset;a!==0&&(r+=t*a/this.getFilmWidth()),this.projectionMatrix.makePerspective(r,r+s,e,e-n,t,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(t){let e=super.toJSON(t);return e.object.fov=this.fov,e.object.zoom=this.zoom,e.object.near=this.near,e.object.far=this.far,e.object.focus=this.focus,e.object.aspect=this.aspect,this.view!==null&&(e.object.view=Object.assign({},this.view)),e.object.filmGauge=this.filmGauge,e.object.filmOffset=this.filmOffset,e}},Or=-90,Br=1,sl=class extends ai{constructor(t,e,n){super(),this.type="CubeCamera",this.renderTarget=n,this.coordinateSystem=null,this.activeMipmapLevel=0;let s=new wn(Or,Br,t,e);s.layers=this.layers,this.add(s);let r=new wn(Or,Br,t,e);r.layers=this.layers,this.add(r);let o=new wn(Or,Br,t,e);o.layers=this.layers,this.add(o);let a=new wn(Or,Br,t,e);a.layers=this.layers,this.add(a);let c=new wn(Or,Br,t,e);c.layers=this.layers,this.add(c);let l=new wn(Or,Br,t,e);l.layers=this.layers,this.add(l)}updateCoordinateSystem(){let t=this.coordinateSystem,e=this.children.concat(),[n,s,r,o,a,c]=e;for(let l of e)this.remove(l);if(t===vi)n.up.set(0,1,0),n.lookAt(1,0,0),s.up.set(0,1,0),s.lookAt(-1,0,0),r.up.set(0,0,-1),r.lookAt(0,1,0),o.up.set(0,0,1),o.lookAt(0,-1,0),a.up.set(0,1,0),a.lookAt(0,0,1),c.up.set(0,1,0),c.lookAt(0,0,-1);else if(t===Lo)n.up.set(0,-1,0),n.lookAt(-1,0,0),s.up.set(0,-1,0),s.lookAt(1,0,0),r.up.set(0,0,1),r.lookAt(0,1,0),o.up.set(0,0,-1),o.lookAt(0,-1,0),a.up.set(0,-1,0),a.lookAt(0,0,1),c.up.set(0,-1,0),c.lookAt(0,0,-1);else throw new Error("THREE.CubeCamera.updateCoordinateSystem(): Invalid coordinate system: "+t);for(let l of e)this.add(l),l.updateMatrixWorld()}update(t,e){this.parent===null&&this.updateMatrixWorld();let{renderTarget:n,activeMipmapLevel:s}=this;this.coordinateSystem!==t.coordinateSystem&&(this.coordinateSystem=t.coordinateSystem,this.updateCoordinateSystem());let[r,o,a,c,l,h]=this.children,u=t.getRenderTarget(),d=t.getActiveCubeFace(),f=t.getActiveMipmapLevel(),g=t.xr.enabled;t.xr.enabled=!1;let x=n.texture.generateMipmaps;n.texture.generateMipmaps=!1,t.setRenderTarget(n,0,s),t.render(e,r),t.setRenderTarget(n,1,s),t.render(e,o),t.setRenderTarget(n,2,s),t.render(e,a),t.setRenderTarget(n,3,s),t.render(e,c),t.setRenderTarget(n,4,s),t.render(e,l),n.texture.generateMipmaps=x,t.setRenderTarget(n,5,s),t.render(e,h),t.setRenderTarget(u,d,f),t.xr.enabled=g,n.texture.needsPMREMUpdate=!0}},ko=class extends zn{constructor(t=[],e=tr,n,s,r,o,a,c,l,h){super(t,e,n,s,r,o,a,c,l,h),this.isCubeTexture=!0,this.flipY=!1}get images(){return this.image}set images(t){this.image=t}},rl=class extends Ii{constructor(t=1,e={}){super(t,t,e),this.isWebGLCubeRenderTarget=!0;let n={width:t,height:t,depth:1},s=[n,n,n,n,n,n];this.texture=new ko(s),this._setTextureOptions(e),this.texture.isRenderTargetTexture=!0}fromEquirectangularTexture(t,e){this.texture.type=e.type,this.texture.colorSpace=e.colorSpace,this.texture.generateMipmaps=e.generateMipmaps,this.texture.minFilter=e.minFilter,this.texture.magFilter=e.magFilter;let n={uniforms:{tEquirect:{value:null}},vertexShader:`

				varying vec3 vWorldDirection;

				vec3 transformDirection( in vec3 dir, in mat4 matrix ) {

					return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );

				}

				void main() {

					vWorldDirection = transformDirection( position, modelMatrix );

					#include <begin_vertex>
					#include <project_vertex>

				}
			`,fragmentShader:`

				uniform sampler2D tEquirect;

				varying vec3 vWorldDirection;

				#include <common>

				void main() {

					vec3 direction = normalize( vWorldDirection );

					vec2 sampleUV = equirectUv( direction );

					gl_FragColor = texture2D( tEquirect, sampleUV );

				}
			`},s=new ys(5,5,5),r=new on({name:"CubemapFromEquirect",uniforms:nr(n.uniforms),vertexShader:n.vertexShader,fragmentShader:n.fragmentShader,side:Fn,blending:Ki});r.uniforms.tEquirect.value=e;let o=new tn(s,r),a=e.minFilter;return e.minFilter===Ts&&(e.minFilter=Mi),new sl(1,10,this).update(t,o),e.minFilter=a,o.geometry.dispose(),o.material.dispose(),this}clear(t,e=!0,n=!0,s=!0){let r=t.getRenderTarget();for(let o=0;o<6;o++)t.setRenderTarget(this,o),t.clear(e,n,s);t.setRenderTarget(r)}},qi=class extends ai{constructor(){super(),this.isGroup=!0,this.type="Group"}},Tx={type:"move"},qr=class{constructor(){this._targetRay=null,this._grip=null,this._hand=null}getHandSpace(){return this._hand===null&&(this._hand=new qi,this._hand.matrixAutoUpdate=!1,this._hand.visible=!1,this._hand.joints={},this._hand.inputState={pinching:!1}),this._hand}getTargetRaySpace(){return this._targetRay===null&&(this._targetRay=new qi,this._targetRay.matrixAutoUpdate=!1,this._targetRay.visible=!1,this._targetRay.hasLinearVelocity=!1,this._targetRay.linearVelocity=new H,this._targetRay.hasAngularVelocity=!1,this._targetRay.angularVelocity=new H),this._targetRay}getGripSpace(){return this._grip===null&&(this._grip=new qi,this._grip.matrixAutoUpdate=!1,this._grip.visible=!1,this._grip.hasLinearVelocity=!1,this._grip.linearVelocity=new H,this._grip.hasAngularVelocity=!1,this._grip.angularVelocity=new H),this._grip}dispatchEvent(t){return this._targetRay!==null&&this._targetRay.dispatchEvent(t),this._grip!==null&&this._grip.dispatchEvent(t),this._hand!==null&&this._hand.dispatchEvent(t),this}connect(t){if(t&&t.hand){let e=this._hand;if(e)for(let n of t.hand.values())this._getHandJoint(e,n)}return this.dispatchEvent({type:"connected",data:t}),this}disconnect(t){return this.dispatchEvent({type:"disconnected",data:t}),this._targetRay!==null&&(this._targetRay.visible=!1),this._grip!==null&&(this._grip.visible=!1),this._hand!==null&&(this._hand.visible=!1),this}update(t,e,n){let s=null,r=null,o=null,a=this._targetRay,c=this._grip,l=this._hand;if(t&&e.session.visibilityState!=="visible-blurred"){if(l&&t.hand){o=!0;for(let x of t.hand.values()){let m=e.getJointPose(x,n),p=this._getHandJoint(l,x);m!==null&&(p.matrix.fromArray(m.transform.matrix),p.matrix.decompose(p.position,p.rotation,p.scale),p.matrixWorldNeedsUpdate=!0,p.jointRadius=m.radius),p.visible=m!==null}let h=l.joints["index-finger-tip"],u=l.joints["thumb-tip"],d=h.position.distanceTo(u.position),f=.02,g=.005;l.inputState.pinching&&d>f+g?(l.inputState.pinching=!1,this.dispatchEvent({type:"pinchend",handedness:t.handedness,target:this})):!l.inputState.pinching&&d<=f-g&&(l.inputState.pinching=!0,this.dispatchEvent({type:"pinchstart",handedness:t.handedness,target:this}))}else c!==null&&t.gripSpace&&(r=e.getPose(t.gripSpace,n),r!==null&&(c.matrix.fromArray(r.transform.matrix),c.matrix.decompose(c.position,c.rotation,c.scale),c.matrixWorldNeedsUpdate=!0,r.linearVelocity?(c.hasLinearVelocity=!0,c.linearVelocity.copy(r.linearVelocity)):c.hasLinearVelocity=!1,r.angularVelocity?(c.hasAngularVelocity=!0,c.angularVelocity.copy(r.angularVelocity)):c.hasAngularVelocity=!1));a!==null&&(s=e.getPose(t.targetRaySpace,n),s===null&&r!==null&&(s=r),s!==null&&(a.matrix.fromArray(s.transform.matrix),a.matrix.decompose(a.position,a.rotation,a.scale),a.matrixWorldNeedsUpdate=!0,s.linearVelocity?(a.hasLinearVelocity=!0,a.linearVelocity.copy(s.linearVelocity)):a.hasLinearVelocity=!1,s.angularVelocity?(a.hasAngularVelocity=!0,a.angularVelocity.copy(s.angularVelocity)):a.hasAngularVelocity=!1,this.dispatchEvent(Tx)))}return a!==null&&(a.visible=s!==null),c!==null&&(c.visible=r!==null),l!==null&&(l.visible=o!==null),this}_getHandJoint(t,e){if(t.joints[e.jointName]===void 0){let n=new qi;n.matrixAutoUpdate=!1,n.visible=!1,t.joints[e.jointName]=n,t.add(n)}return t.joints[e.jointName]}};var zo=class extends ai{constructor(){super(),this.isScene=!0,this.type="Scene",this.background=null,this.environment=null,this.fog=null,this.backgroundBlurriness=0,this.backgroundIntensity=1,this.backgroundRotation=new Li,this.environmentIntensity=1,this.environmentRotation=new Li,this.overrideMaterial=null,typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}copy(t,e){return super.copy(t,e),t.background!==null&&(this.background=t.background.clone()),t.environment!==null&&(this.environment=t.environment.clone()),t.fog!==null&&(this.fog=t.fog.clone()),this.backgroundBlurriness=t.backgroundBlurriness,this.backgroundIntensity=t.backgroundIntensity,this.backgroundRotation.copy(t.backgroundRotation),this.environmentIntensity=t.environmentIntensity,this.environmentRotation.copy(t.environmentRotation),t.overrideMaterial!==null&&(this.overrideMaterial=t.overrideMaterial.clone()),this.matrixAutoUpdate=t.matrixAutoUpdate,this}toJSON(t){let e=super.toJSON(t);return this.fog!==null&&(e.object.fog=this.fog.toJSON()),this.backgroundBlurriness>0&&(e.object.backgroundBlurriness=this.backgroundBlurriness),this.backgroundIntensity!==1&&(e.object.backgroundIntensity=this.backgroundIntensity),e.object.backgroundRotation=this.backgroundRotation.toArray(),this.environmentIntensity!==1&&(e.object.environmentIntensity=this.environmentIntensity),e.object.environmentRotation=this.environmentRotation.toArray(),e}},Ks=class{constructor(t,e){this.isInterleavedBuffer=!0,this.array=t,this.stride=e,this.count=t!==void 0?t.length/e:0,this.usage=tl,this.updateRanges=[],this.version=0,this.uuid=Yi()}onUploadCallback(){}set needsUpdate(t){t===!0&&this.version++}setUsage(t){return this.usage=t,this}addUpdateRange(t,e){this.updateRanges.push({start:t,count:e})}clearUpdateRanges(){this.updateRanges.length=0}copy(t){return this.array=new t.array.constructor(t.array),this.count=t.count,this.stride=t.stride,this.usage=t.usage,this}copyAt(t,e,n){t*=this.stride,n*=e.stride;for(let s=0,r=this.stride;s<r;s++)this.array[t+s]=e.array[n+s];return this}set(t,e=0){return this.array.set(t,e),this}clone(t){t.arrayBuffers===void 0&&(t.arrayBuffers={}),this.array.buffer._uuid===void 0&&(this.array.buffer._uuid=Yi()),t.arrayBuffers[this.array.buffer._uuid]===void 0&&(t.arrayBuffers[this.array.buffer._uuid]=this.array.slice(0).buffer);let e=new this.array.constructor(t.arrayBuffers[this.array.buffer._uuid]),n=new this.constructor(e,this.stride);return n.setUsage(this.usage),n}onUpload(t){return this.onUploadCallback=t,this}toJSON(t){return t.arrayBuffers===void 0&&(t.arrayBuffers={}),this.array.buffer._uuid===void 0&&(this.array.buffer._uuid=Yi()),t.arrayBuffers[this.array.buffer._uuid]===void 0&&(t.arrayBuffers[this.array.buffer._uuid]=Array.from(new Uint32Array(this.array.buffer))),{uuid:this.uuid,buffer:this.array.buffer._uuid,type:this.array.constructor.name,stride:this.stride}}},Dn=new H,Ji=class i{constructor(t,e,n,s=!1){this.isInterleavedBufferAttribute=!0,this.name="",this.data=t,this.itemSize=e,this.offset=n,this.normalized=s}get count(){return this.data.count}get array(){return this.data.array}set needsUpdate(t){this.data.needsUpdate=t}applyMatrix4(t){for(let e=0,n=this.data.count;e<n;e++)Dn.fromBufferAttribute(this,e),Dn.applyMatrix4(t),this.setXYZ(e,Dn.x,Dn.y,Dn.z);return this}applyNormalMatrix(t){for(let e=0,n=this.count;e<n;e++)Dn.fromBufferAttribute(this,e),Dn.applyNormalMatrix(t),this.setXYZ(e,Dn.x,Dn.y,Dn.z);return this}transformDirection(t){for(let e=0,n=this.count;e<n;e++)Dn.fromBufferAttribute(this,e),Dn.transformDirection(t),this.setXYZ(e,Dn.x,Dn.y,Dn.z);return this}getComponent(t,e){let n=this.array[t*this.data.stride+this.offset+e];return this.normalized&&(n=yi(n,this.array)),n}setComponent(t,e,n){return this.normalized&&(n=we(n,this.array)),this.data.array[t*this.data.stride+this.offset+e]=n,this}setX(t,e){return this.normalized&&(e=we(e,this.array)),this.data.array[t*this.data.stride+this.offset]=e,this}setY(t,e){return this.normalized&&(e=we(e,this.array)),this.data.array[t*this.data.stride+this.offset+1]=e,this}setZ(t,e){return this.normalized&&(e=we(e,this.array)),this.data.array[t*this.data.stride+this.offset+2]=e,this}setW(t,e){return this.normalized&&(e=we(e,this.array)),this.data.array[t*this.data.stride+this.offset+3]=e,this}getX(t){let e=this.data.array[t*this.data.stride+this.offset];return this.normalized&&(e=yi(e,this.array)),e}getY(t){let e=this.data.array[t*this.data.stride+this.offset+1];return this.normalized&&(e=yi(e,this.array)),e}getZ(t){let e=this.data.array[t*this.data.stride+this.offset+2];return this.normalized&&(e=yi(e,this.array)),e}getW(t){let e=this.data.array[t*this.data.stride+this.offset+3];return this.normalized&&(e=yi(e,this.array)),e}setXY(t,e,n){return t=t*this.data.stride+this.offset,this.normalized&&(e=we(e,this.array),n=we(n,this.array)),this.data.array[t+0]=e,this.data.array[t+1]=n,this}setXYZ(t,e,n,s){return t=t*this.data.stride+this.offset,this.normalized&&(e=we(e,this.array),n=we(n,this.array),s=we(s,this.array)),this.data.array[t+0]=e,this.data.array[t+1]=n,this.data.array[t+2]=s,this}setXYZW(t,e,n,s,r){return t=t*this.data.stride+this.offset,this.normalized&&(e=we(e,this.array),n=we(n,this.array),s=we(s,this.array),r=we(r,this.array)),this.data.array[t+0]=e,this.data.array[t+1]=n,this.data.array[t+2]=s,this.data.array[t+3]=r,this}clone(t){if(t===void 0){console.log("THREE.InterleavedBufferAttribute.clone(): Cloning an interleaved buffer attribute will de-interleave buffer data.");let e=[];for(let n=0;n<this.count;n++){let s=n*this.data.stride+this.offset;for(let r=0;r<this.itemSize;r++)e.push(this.data.array[s+r])}return new Oe(new this.array.constructor(e),this.itemSize,this.normalized)}else return t.interleavedBuffers===void 0&&(t.interleavedBuffers={}),t.interleavedBuffers[this.data.uuid]===void 0&&(t.interleavedBuffers[this.data.uuid]=this.data.clone(t)),new i(t.interleavedBuffers[this.data.uuid],this.itemSize,this.offset,this.normalized)}toJSON(t){if(t===void 0){console.log("THREE.InterleavedBufferAttribute.toJSON(): Serializing an interleaved buffer attribute will de-interleave buffer data.");let e=[];for(let n=0;n<this.count;n++){let s=n*this.data.stride+this.offset;for(let r=0;r<this.itemSize;r++)e.push(this.data.array[s+r])}return{itemSize:this.itemSize,type:this.array.constructor.name,array:e,normalized:this.normalized}}else return t.interleavedBuffers===void 0&&(t.interleavedBuffers={}),t.interleavedBuffers[this.data.uuid]===void 0&&(t.interleavedBuffers[this.data.uuid]=this.data.toJSON(t)),{isInterleavedBufferAttribute:!0,itemSize:this.itemSize,data:this.data.uuid,offset:this.offset,normalized:this.normalized}}};var ol=class extends zn{constructor(t=null,e=1,n=1,s,r,o,a,c,l=kn,h=kn,u,d){super(null,o,a,c,l,h,s,r,u,d),this.isDataTexture=!0,this.image={data:t,width:e,height:n},this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}};var Yr=class extends Oe{constructor(t,e,n,s=1){super(t,e,n),this.isInstancedBufferAttribute=!0,this.meshPerAttribute=s}copy(t){return super.copy(t),this.meshPerAttribute=t.meshPerAttribute,this}toJSON(){let t=super.toJSON();return t.meshPerAttribute=this.meshPerAttribute,t.isInstancedBufferAttribute=!0,t}},kr=new Re,gp=new Re,Xa=[],_p=new oi,Ax=new Re,To=new tn,Ao=new xs,js=class extends tn{constructor(t,e,n){super(t,e),this.isInstancedMesh=!0,this.instanceMatrix=new Yr(new Float32Array(n*16),16),this.instanceColor=null,this.morphTexture=null,this.count=n,this.boundingBox=null,this.boundingSphere=null;for(let s=0;s<n;s++)this.setMatrixAt(s,Ax)}computeBoundingBox(){let t=this.geometry,e=this.count;this.boundingBox===null&&(this.boundingBox=new oi),t.boundingBox===null&&t.computeBoundingBox(),this.boundingBox.makeEmpty();for(let n=0;n<e;n++)this.getMatrixAt(n,kr),_p.copy(t.boundingBox).applyMatrix4(kr),this.boundingBox.union(_p)}computeBoundingSphere(){let t=this.geometry,e=this.count;this.boundingSphere===null&&(this.boundingSphere=new xs),t.boundingSphere===null&&t.computeBoundingSphere(),this.boundingSphere.makeEmpty();for(let n=0;n<e;n++)this.getMatrixAt(n,kr),Ao.copy(t.boundingSphere).applyMatrix4(kr),this.boundingSphere.union(Ao)}copy(t,e){return super.copy(t,e),this.instanceMatrix.copy(t.instanceMatrix),t.morphTexture!==null&&(this.morphTexture=t.morphTexture.clone()),t.instanceColor!==null&&(this.instanceColor=t.instanceColor.clone()),this.count=t.count,t.boundingBox!==null&&(this.boundingBox=t.boundingBox.clone()),t.boundingSphere!==null&&(this.boundingSphere=t.boundingSphere.clone()),this}getColorAt(t,e){e.fromArray(this.instanceColor.array,t*3)}getMatrixAt(t,e){e.fromArray(this.instanceMatrix.array,t*16)}getMorphAt(t,e){let n=e.morphTargetInfluences,s=this.morphTexture.source.data.data,r=n.length+1,o=t*r+1;for(let a=0;a<n.length;a++)n[a]=s[o+a]}raycast(t,e){let n=this.matrixWorld,s=this.count;if(To.geometry=this.geometry,To.material=this.material,To.material!==void 0&&(this.boundingSphere===null&&this.computeBoundingSphere(),Ao.copy(this.boundingSphere),Ao.applyMatrix4(n),t.ray.intersectsSphere(Ao)!==!1))for(let r=0;r<s;r++){this.getMatrixAt(r,kr),gp.multiplyMatrices(n,kr),To.matrixWorld=gp,To.raycast(t,Xa);for(let o=0,a=Xa.length;o<a;o++){let c=Xa[o];c.instanceId=r,c.object=this,e.push(c)}Xa.length=0}}setColorAt(t,e){this.instanceColor===null&&(this.instanceColor=new Yr(new Float32Array(this.instanceMatrix.count*3).fill(1),3)),e.toArray(this.instanceColor.array,t*3)}setMatrixAt(t,e){e.toArray(this.instanceMatrix.array,t*16)}setMorphAt(t,e){let n=e.morphTargetInfluences,s=n.length+1;this.morphTexture===null&&(this.morphTexture=new ol(new Float32Array(s*this.count),s,this.count,Dl,bi));let r=this.morphTexture.source.data.data,o=0;for(let l=0;l<n.length;l++)o+=n[l];let a=this.geometry.morphTargetsRelative?1:1-o,c=s*t;r[c]=a,r.set(n,c+1)}updateMorphTargets(){}dispose(){this.dispatchEvent({type:"dispose"}),this.morphTexture!==null&&(this.morphTexture.dispose(),this.morphTexture=null)}},zh=new H,Rx=new H,Cx=new re,ri=class{constructor(t=new H(1,0,0),e=0){this.isPlane=!0,this.normal=t,this.constant=e}set(t,e){return this.normal.copy(t),this.constant=e,this}setComponents(t,e,n,s){return this.normal.set(t,e,n),this.constant=s,this}setFromNormalAndCoplanarPoint(t,e){return this.normal.copy(t),this.constant=-e.dot(this.normal),this}setFromCoplanarPoints(t,e,n){let s=zh.subVectors(n,e).cross(Rx.subVectors(t,e)).normalize();return this.setFromNormalAndCoplanarPoint(s,t),this}copy(t){return this.normal.copy(t.normal),this.constant=t.constant,this}normalize(){let t=1/this.normal.length();return this.normal.multiplyScalar(t),this.constant*=t,this}negate(){return this.constant*=-1,this.normal.negate(),this}distanceToPoint(t){return this.normal.dot(t)+this.constant}distanceToSphere(t){return this.distanceToPoint(t.center)-t.radius}projectPoint(t,e){return e.copy(t).addScaledVector(this.normal,-this.distanceToPoint(t))}intersectLine(t,e){let n=t.delta(zh),s=this.normal.dot(n);if(s===0)return this.distanceToPoint(t.start)===0?e.copy(t.start):null;let r=-(t.start.dot(this.normal)+this.constant)/s;return r<0||r>1?null:e.copy(t.start).addScaledVector(n,r)}intersectsLine(t){let e=this.distanceToPoint(t.start),n=this.distanceToPoint(t.end);return e<0&&n>0||n<0&&e>0}intersectsBox(t){return t.intersectsPlane(this)}intersectsSphere(t){return t.intersectsPlane(this)}coplanarPoint(t){return t.copy(this.normal).multiplyScalar(-this.constant)}applyMatrix4(t,e){let n=e||Cx.getNormalMatrix(t),s=this.coplanarPoint(zh).applyMatrix4(t),r=this.normal.applyMatrix3(n).normalize();return this.constant=-s.dot(r),this}translate(t){return this.constant-=t.dot(this.normal),this}equals(t){return t.normal.equals(this.normal)&&t.constant===this.constant}clone(){return new this.constructor().copy(this)}},Ws=new xs,Px=new Jt(.5,.5),qa=new H,Vo=class{constructor(t=new ri,e=new ri,n=new ri,s=new ri,r=new ri,o=new ri){this.planes=[t,e,n,s,r,o]}set(t,e,n,s,r,o){let a=this.planes;return a[0].copy(t),a[1].copy(e),a[2].copy(n),a[3].copy(s),a[4].copy(r),a[5].copy(o),this}copy(t){let e=this.planes;for(let n=0;n<6;n++)e[n].copy(t.planes[n]);return this}setFromProjectionMatrix(t,e=vi,n=!1){let s=this.planes,r=t.elements,o=r[0],a=r[1],c=r[2],l=r[3],h=r[4],u=r[5],d=r[6],f=r[7],g=r[8],x=r[9],m=r[10],p=r[11],w=r[12],E=r[13],v=r[14],C=r[15];if(s[0].setComponents(l-o,f-h,p-g,C-w).normalize(),s[1].setComponents(l+o,f+h,p+g,C+w).normalize(),s[2].setComponents(l+a,f+u,p+x,C+E).normalize(),s[3].setComponents(l-a,f-u,p-x,C-E).normalize(),n)s[4].setComponents(c,d,m,v).normalize(),s[5].setComponents(l-c,f-d,p-m,C-v).normalize();else if(s[4].setComponents(l-c,f-d,p-m,C-v).normalize(),e===vi)s[5].setComponents(l+c,f+d,p+m,C+v).normalize();else if(e===Lo)s[5].setComponents(c,d,m,v).normalize();else throw new Error("THREE.Frustum.setFromProjectionMatrix(): Invalid coordinate system: "+e);return this}intersectsObject(t){if(t.boundingSphere!==void 0)t.boundingSphere===null&&t.computeBoundingSphere(),Ws.copy(t.boundingSphere).applyMatrix4(t.matrixWorld);else{let e=t.geometry;e.boundingSphere===null&&e.computeBoundingSphere(),Ws.copy(e.boundingSphere).applyMatrix4(t.matrixWorld)}return this.intersectsSphere(Ws)}intersectsSprite(t){Ws.center.set(0,0,0);let e=Px.distanceTo(t.center);return Ws.radius=.7071067811865476+e,Ws.applyMatrix4(t.matrixWorld),this.intersectsSphere(Ws)}intersectsSphere(t){let e=this.planes,n=t.center,s=-t.radius;for(let r=0;r<6;r++)if(e[r].distanceToPoint(n)<s)return!1;return!0}intersectsBox(t){let e=this.planes;for(let n=0;n<6;n++){let s=e[n];if(qa.x=s.normal.x>0?t.max.x:t.min.x,qa.y=s.normal.y>0?t.max.y:t.min.y,qa.z=s.normal.z>0?t.max.z:t.min.z,s.distanceToPoint(qa)<0)return!1}return!0}containsPoint(t){let e=this.planes;for(let n=0;n<6;n++)if(e[n].distanceToPoint(t)<0)return!1;return!0}clone(){return new this.constructor().copy(this)}};var Ho=class extends zn{constructor(t,e,n=As,s,r,o,a=kn,c=kn,l,h=Vr,u=1){if(h!==Vr&&h!==jr)throw new Error("DepthTexture format must be either THREE.DepthFormat or THREE.DepthStencilFormat");let d={width:t,height:e,depth:u};super(d,s,r,o,a,c,h,n,l),this.isDepthTexture=!0,this.flipY=!1,this.generateMipmaps=!1,this.compareFunction=null}copy(t){return super.copy(t),this.source=new Wr(Object.assign({},t.image)),this.compareFunction=t.compareFunction,this}toJSON(t){let e=super.toJSON(t);return this.compareFunction!==null&&(e.compareFunction=this.compareFunction),e}},Go=class extends zn{constructor(t=null){super(),this.sourceTexture=t,this.isExternalTexture=!0}copy(t){return super.copy(t),this.sourceTexture=t.sourceTexture,this}},Wo=class i extends Qe{constructor(t=1,e=1,n=4,s=8,r=1){super(),this.type="CapsuleGeometry",this.parameters={radius:t,height:e,capSegments:n,radialSegments:s,heightSegments:r},e=Math.max(0,e),n=Math.max(1,Math.floor(n)),s=Math.max(3,Math.floor(s)),r=Math.max(1,Math.floor(r));let o=[],a=[],c=[],l=[],h=e/2,u=Math.PI/2*t,d=e,f=2*u+d,g=n*2+r,x=s+1,m=new H,p=new H;for(let w=0;w<=g;w++){let E=0,v=0,C=0,A=0;if(w<=n){let S=w/n,b=S*Math.PI/2;v=-h-t*Math.cos(b),C=t*Math.sin(b),A=-t*Math.cos(b),E=S*u}else if(w<=n+r){let S=(w-n)/r;v=-h+S*e,C=t,A=0,E=u+S*d}else{let S=(w-n-r)/n,b=S*Math.PI/2;v=h+t*Math.sin(b),C=t*Math.cos(b),A=t*Math.sin(b),E=u+d+S*u}let D=Math.max(0,Math.min(1,E/f)),U=0;w===0?U=.5/s:w===g&&(U=-.5/s);for(let S=0;S<=s;S++){let b=S/s,P=b*Math.PI*2,O=Math.sin(P),z=Math.cos(P);p.x=-C*z,p.y=v,p.z=C*O,a.push(p.x,p.y,p.z),m.set(-C*z,A,C*O),m.normalize(),c.push(m.x,m.y,m.z),l.push(b+U,D)}if(w>0){let S=(w-1)*x;for(let b=0;b<s;b++){let P=S+b,O=S+b+1,z=w*x+b,W=w*x+b+1;o.push(P,O,z),o.push(O,W,z)}}}this.setIndex(o),this.setAttribute("position",new qe(a,3)),this.setAttribute("normal",new qe(c,3)),this.setAttribute("uv",new qe(l,2))}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.radius,t.height,t.capSegments,t.radialSegments,t.heightSegments)}},Xo=class i extends Qe{constructor(t=1,e=32,n=0,s=Math.PI*2){super(),this.type="CircleGeometry",this.parameters={radius:t,segments:e,thetaStart:n,thetaLength:s},e=Math.max(3,e);let r=[],o=[],a=[],c=[],l=new H,h=new Jt;o.push(0,0,0),a.push(0,0,1),c.push(.5,.5);for(let u=0,d=3;u<=e;u++,d+=3){let f=n+u/e*s;l.x=t*Math.cos(f),l.y=t*Math.sin(f),o.push(l.x,l.y,l.z),a.push(0,0,1),h.x=(o[d]/t+1)/2,h.y=(o[d+1]/t+1)/2,c.push(h.x,h.y)}for(let u=1;u<=e;u++)r.push(u,u+1,0);this.setIndex(r),this.setAttribute("position",new qe(o,3)),this.setAttribute("normal",new qe(a,3)),this.setAttribute("uv",new qe(c,2))}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.radius,t.segments,t.thetaStart,t.thetaLength)}},$r=class i extends Qe{constructor(t=1,e=1,n=1,s=32,r=1,o=!1,a=0,c=Math.PI*2){super(),this.type="CylinderGeometry",this.parameters={radiusTop:t,radiusBottom:e,height:n,radialSegments:s,heightSegments:r,openEnded:o,thetaStart:a,thetaLength:c};let l=this;s=Math.floor(s),r=Math.floor(r);let h=[],u=[],d=[],f=[],g=0,x=[],m=n/2,p=0;w(),o===!1&&(t>0&&E(!0),e>0&&E(!1)),this.setIndex(h),this.setAttribute("position",new qe(u,3)),this.setAttribute("normal",new qe(d,3)),this.setAttribute("uv",new qe(f,2));function w(){let v=new H,C=new H,A=0,D=(e-t)/n;for(let U=0;U<=r;U++){let S=[],b=U/r,P=b*(e-t)+t;for(let O=0;O<=s;O++){let z=O/s,W=z*c+a,X=Math.sin(W),Y=Math.cos(W);C.x=P*X,C.y=-b*n+m,C.z=P*Y,u.push(C.x,C.y,C.z),v.set(X,D,Y).normalize(),d.push(v.x,v.y,v.z),f.push(z,1-b),S.push(g++)}x.push(S)}for(let U=0;U<s;U++)for(let S=0;S<r;S++){let b=x[S][U],P=x[S+1][U],O=x[S+1][U+1],z=x[S][U+1];(t>0||S!==0)&&(h.push(b,P,z),A+=3),(e>0||S!==r-1)&&(h.push(P,O,z),A+=3)}l.addGroup(p,A,0),p+=A}function E(v){let C=g,A=new Jt,D=new H,U=0,S=v===!0?t:e,b=v===!0?1:-1;for(let O=1;O<=s;O++)u.push(0,m*b,0),d.push(0,b,0),f.push(.5,.5),g++;let P=g;for(let O=0;O<=s;O++){let W=O/s*c+a,X=Math.cos(W),Y=Math.sin(W);D.x=S*Y,D.y=m*b,D.z=S*X,u.push(D.x,D.y,D.z),d.push(0,b,0),A.x=X*.5+.5,A.y=Y*.5*b+.5,f.push(A.x,A.y),g++}for(let O=0;O<s;O++){let z=C+O,W=P+O;v===!0?h.push(W,W+1,z):h.push(W+1,W,z),U+=3}l.addGroup(p,U,v===!0?1:2),p+=U}}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.radiusTop,t.radiusBottom,t.height,t.radialSegments,t.heightSegments,t.openEnded,t.thetaStart,t.thetaLength)}};var qo=class i extends Qe{constructor(t=1,e=1,n=1,s=1){super(),this.type="PlaneGeometry",this.parameters={width:t,height:e,widthSegments:n,heightSegments:s};let r=t/2,o=e/2,a=Math.floor(n),c=Math.floor(s),l=a+1,h=c+1,u=t/a,d=e/c,f=[],g=[],x=[],m=[];for(let p=0;p<h;p++){let w=p*d-o;for(let E=0;E<l;E++){let v=E*u-r;g.push(v,-w,0),x.push(0,0,1),m.push(E/a),m.push(1-p/c)}}for(let p=0;p<c;p++)for(let w=0;w<a;w++){let E=w+l*p,v=w+l*(p+1),C=w+1+l*(p+1),A=w+1+l*p;f.push(E,v,A),f.push(v,C,A)}this.setIndex(f),this.setAttribute("position",new qe(g,3)),this.setAttribute("normal",new qe(x,3)),this.setAttribute("uv",new qe(m,2))}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.width,t.height,t.widthSegments,t.heightSegments)}};var vs=class i extends Qe{constructor(t=1,e=32,n=16,s=0,r=Math.PI*2,o=0,a=Math.PI){super(),this.type="SphereGeometry",this.parameters={radius:t,widthSegments:e,heightSegments:n,phiStart:s,phiLength:r,thetaStart:o,thetaLength:a},e=Math.max(3,Math.floor(e)),n=Math.max(2,Math.floor(n));let c=Math.min(o+a,Math.PI),l=0,h=[],u=new H,d=new H,f=[],g=[],x=[],m=[];for(let p=0;p<=n;p++){let w=[],E=p/n,v=0;p===0&&o===0?v=.5/e:p===n&&c===Math.PI&&(v=-.5/e);for(let C=0;C<=e;C++){let A=C/e;u.x=-t*Math.cos(s+A*r)*Math.sin(o+E*a),u.y=t*Math.cos(o+E*a),u.z=t*Math.sin(s+A*r)*Math.sin(o+E*a),g.push(u.x,u.y,u.z),d.copy(u).normalize(),x.push(d.x,d.y,d.z),m.push(A+v,1-E),w.push(l++)}h.push(w)}for(let p=0;p<n;p++)for(let w=0;w<e;w++){let E=h[p][w+1],v=h[p][w],C=h[p+1][w],A=h[p+1][w+1];(p!==0||o>0)&&f.push(E,v,A),(p!==n-1||c<Math.PI)&&f.push(v,C,A)}this.setIndex(f),this.setAttribute("position",new qe(g,3)),this.setAttribute("normal",new qe(x,3)),this.setAttribute("uv",new qe(m,2))}copy(t){return super.copy(t),this.parameters=Object.assign({},t.parameters),this}static fromJSON(t){return new i(t.radius,t.widthSegments,t.heightSegments,t.phiStart,t.phiLength,t.thetaStart,t.thetaLength)}};var al=class extends Zs{constructor(t){super(),this.isMeshDepthMaterial=!0,this.type="MeshDepthMaterial",this.depthPacking=Zp,this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.wireframe=!1,this.wireframeLinewidth=1,this.setValues(t)}copy(t){return super.copy(t),this.depthPacking=t.depthPacking,this.map=t.map,this.alphaMap=t.alphaMap,this.displacementMap=t.displacementMap,this.displacementScale=t.displacementScale,this.displacementBias=t.displacementBias,this.wireframe=t.wireframe,this.wireframeLinewidth=t.wireframeLinewidth,this}},ll=class extends Zs{constructor(t){super(),this.isMeshDistanceMaterial=!0,this.type="MeshDistanceMaterial",this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.setValues(t)}copy(t){return super.copy(t),this.map=t.map,this.alphaMap=t.alphaMap,this.displacementMap=t.displacementMap,this.displacementScale=t.displacementScale,this.displacementBias=t.displacementBias,this}};function Ya(i,t){return!i||i.constructor===t?i:typeof t.BYTES_PER_ELEMENT=="number"?new t(i):Array.prototype.slice.call(i)}function Ix(i){return ArrayBuffer.isView(i)&&!(i instanceof DataView)}var Qs=class{constructor(t,e,n,s){this.parameterPositions=t,this._cachedIndex=0,this.resultBuffer=s!==void 0?s:new e.constructor(n),this.sampleValues=e,this.valueSize=n,this.settings=null,this.DefaultSettings_={}}evaluate(t){let e=this.parameterPositions,n=this._cachedIndex,s=e[n],r=e[n-1];n:{t:{let o;e:{i:if(!(t<s)){for(let a=n+2;;){if(s===void 0){if(t<r)break i;return n=e.length,this._cachedIndex=n,this.copySampleValue_(n-1)}if(n===a)break;if(r=s,s=e[++n],t<s)break t}o=e.length;break e}if(!(t>=r)){let a=e[1];t<a&&(n=2,r=a);for(let c=n-2;;){if(r===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(n===c)break;if(s=r,r=e[--n-1],t>=r)break t}o=n,n=0;break e}break n}for(;n<o;){let a=n+o>>>1;t<e[a]?o=a:n=a+1}if(s=e[n],r=e[n-1],r===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(s===void 0)return n=e.length,this._cachedIndex=n,this.copySampleValue_(n-1)}this._cachedIndex=n,this.intervalChanged_(n,r,s)}return this.interpolate_(n,r,t,s)}getSettings_(){return this.settings||this.DefaultSettings_}copySampleValue_(t){let e=this.resultBuffer,n=this.sampleValues,s=this.valueSize,r=t*s;for(let o=0;o!==s;++o)e[o]=n[r+o];return e}interpolate_(){throw new Error("call to abstract method")}intervalChanged_(){}},cl=class extends Qs{constructor(t,e,n,s){super(t,e,n,s),this._weightPrev=-0,this._offsetPrev=-0,this._weightNext=-0,this._offsetNext=-0,this.DefaultSettings_={endingStart:Vh,endingEnd:Vh}}intervalChanged_(t,e,n){let s=this.parameterPositions,r=t-2,o=t+1,a=s[r],c=s[o];if(a===void 0)switch(this.getSettings_().endingStart){case Hh:r=t,a=2*e-n;break;case Gh:r=s.length-2,a=e+s[r]-s[r+1];break;default:r=t,a=n}if(c===void 0)switch(this.getSettings_().endingEnd){case Hh:o=t,c=2*n-e;break;case Gh:o=1,c=n+s[1]-s[0];break;default:o=t-1,c=e}let l=(n-e)*.5,h=this.valueSize;this._weightPrev=l/(e-a),this._weightNext=l/(c-n),this._offsetPrev=r*h,this._offsetNext=o*h}interpolate_(t,e,n,s){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,c=t*a,l=c-a,h=this._offsetPrev,u=this._offsetNext,d=this._weightPrev,f=this._weightNext,g=(n-e)/(s-e),x=g*g,m=x*g,p=-d*m+2*d*x-d*g,w=(1+d)*m+(-1.5-2*d)*x+(-.5+d)*g+1,E=(-1-f)*m+(1.5+f)*x+.5*g,v=f*m-f*x;for(let C=0;C!==a;++C)r[C]=p*o[h+C]+w*o[l+C]+E*o[c+C]+v*o[u+C];return r}},hl=class extends Qs{constructor(t,e,n,s){super(t,e,n,s)}interpolate_(t,e,n,s){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,c=t*a,l=c-a,h=(n-e)/(s-e),u=1-h;for(let d=0;d!==a;++d)r[d]=o[l+d]*u+o[c+d]*h;return r}},ul=class extends Qs{constructor(t,e,n,s){super(t,e,n,s)}interpolate_(t){return this.copySampleValue_(t-1)}},jn=class{constructor(t,e,n,s){if(t===void 0)throw new Error("THREE.KeyframeTrack: track name is undefined");if(e===void 0||e.length===0)throw new Error("THREE.KeyframeTrack: no keyframes in track named "+t);this.name=t,this.times=Ya(e,this.TimeBufferType),this.values=Ya(n,this.ValueBufferType),this.setInterpolation(s||this.DefaultInterpolation)}static toJSON(t){let e=t.constructor,n;if(e.toJSON!==this.toJSON)n=e.toJSON(t);else{n={name:t.name,times:Ya(t.times,Array),values:Ya(t.values,Array)};let s=t.getInterpolation();s!==t.DefaultInterpolation&&(n.interpolation=s)}return n.type=t.ValueTypeName,n}InterpolantFactoryMethodDiscrete(t){return new ul(this.times,this.values,this.getValueSize(),t)}InterpolantFactoryMethodLinear(t){return new hl(this.times,this.values,this.getValueSize(),t)}InterpolantFactoryMethodSmooth(t){return new cl(this.times,this.values,this.getValueSize(),t)}setInterpolation(t){let e;switch(t){case Po:e=this.InterpolantFactoryMethodDiscrete;break;case Qa:e=this.InterpolantFactoryMethodLinear;break;case $a:e=this.InterpolantFactoryMethodSmooth;break}if(e===void 0){let n="unsupported interpolation for "+this.ValueTypeName+" keyframe track named "+this.name;if(this.createInterpolant===void 0)if(t!==this.DefaultInterpolation)this.setInterpolation(this.DefaultInterpolation);else throw new Error(n);return console.warn("THREE.KeyframeTrack:",n),this}return this.createInterpolant=e,this}getInterpolation(){switch(this.createInterpolant){case this.InterpolantFactoryMethodDiscrete:return Po;case this.InterpolantFactoryMethodLinear:return Qa;case this.InterpolantFactoryMethodSmooth:return $a}}getValueSize(){return this.values.length/this.times.length}shift(t){if(t!==0){let e=this.times;for(let n=0,s=e.length;n!==s;++n)e[n]+=t}return this}scale(t){if(t!==1){let e=this.times;for(let n=0,s=e.length;n!==s;++n)e[n]*=t}return this}trim(t,e){let n=this.times,s=n.length,r=0,o=s-1;for(;r!==s&&n[r]<t;)++r;for(;o!==-1&&n[o]>e;)--o;if(++o,r!==0||o!==s){r>=o&&(o=Math.max(o,1),r=o-1);let a=this.getValueSize();this.times=n.slice(r,o),this.values=this.values.slice(r*a,o*a)}return this}validate(){let t=!0,e=this.getValueSize();e-Math.floor(e)!==0&&(console.error("THREE.KeyframeTrack: Invalid value size in track.",this),t=!1);let n=this.times,s=this.values,r=n.length;r===0&&(console.error("THREE.KeyframeTrack: Track is empty.",this),t=!1);let o=null;for(let a=0;a!==r;a++){let c=n[a];if(typeof c=="number"&&isNaN(c)){console.error("THREE.KeyframeTrack: Time is not a valid number.",this,a,c),t=!1;break}if(o!==null&&o>c){console.error("THREE.KeyframeTrack: Out of order keys.",this,a,c,o),t=!1;break}o=c}if(s!==void 0&&Ix(s))for(let a=0,c=s.length;a!==c;++a){let l=s[a];if(isNaN(l)){console.error("THREE.KeyframeTrack: Value is not a valid number.",this,a,l),t=!1;break}}return t}optimize(){let t=this.times.slice(),e=this.values.slice(),n=this.getValueSize(),s=this.getInterpolation()===$a,r=t.length-1,o=1;for(let a=1;a<r;++a){let c=!1,l=t[a],h=t[a+1];if(l!==h&&(a!==1||l!==t[0]))if(s)c=!0;else{let u=a*n,d=u-n,f=u+n;for(let g=0;g!==n;++g){let x=e[u+g];if(x!==e[d+g]||x!==e[f+g]){c=!0;break}}}if(c){if(a!==o){t[o]=t[a];let u=a*n,d=o*n;for(let f=0;f!==n;++f)e[d+f]=e[u+f]}++o}}if(r>0){t[o]=t[r];for(let a=r*n,c=o*n,l=0;l!==n;++l)e[c+l]=e[a+l];++o}return o!==t.length?(this.times=t.slice(0,o),this.values=e.slice(0,o*n)):(this.times=t,this.values=e),this}clone(){let t=this.times.slice(),e=this.values.slice(),n=this.constructor,s=new n(this.name,t,e);return s.createInterpolant=this.createInterpolant,s}};jn.prototype.ValueTypeName="";jn.prototype.TimeBufferType=Float32Array;jn.prototype.ValueBufferType=Float32Array;jn.prototype.DefaultInterpolation=Qa;var Ms=class extends jn{constructor(t,e,n){super(t,e,n)}};Ms.prototype.ValueTypeName="bool";Ms.prototype.ValueBufferType=Array;Ms.prototype.DefaultInterpolation=Po;Ms.prototype.InterpolantFactoryMethodLinear=void 0;Ms.prototype.InterpolantFactoryMethodSmooth=void 0;var dl=class extends jn{constructor(t,e,n,s){super(t,e,n,s)}};dl.prototype.ValueTypeName="color";var fl=class extends jn{constructor(t,e,n,s){super(t,e,n,s)}};fl.prototype.ValueTypeName="number";var pl=class extends Qs{constructor(t,e,n,s){super(t,e,n,s)}interpolate_(t,e,n,s){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,c=(n-e)/(s-e),l=t*a;for(let h=l+a;l!==h;l+=4)Un.slerpFlat(r,0,o,l-a,o,l,c);return r}},Yo=class extends jn{constructor(t,e,n,s){super(t,e,n,s)}InterpolantFactoryMethodLinear(t){return new pl(this.times,this.values,this.getValueSize(),t)}};Yo.prototype.ValueTypeName="quaternion";Yo.prototype.InterpolantFactoryMethodSmooth=void 0;var bs=class extends jn{constructor(t,e,n){super(t,e,n)}};bs.prototype.ValueTypeName="string";bs.prototype.ValueBufferType=Array;bs.prototype.DefaultInterpolation=Po;bs.prototype.InterpolantFactoryMethodLinear=void 0;bs.prototype.InterpolantFactoryMethodSmooth=void 0;var ml=class extends jn{constructor(t,e,n,s){super(t,e,n,s)}};ml.prototype.ValueTypeName="vector";var gl=class{constructor(t,e,n){let s=this,r=!1,o=0,a=0,c,l=[];this.onStart=void 0,this.onLoad=t,this.onProgress=e,this.onError=n,this.abortController=new AbortController,this.itemStart=function(h){a++,r===!1&&s.onStart!==void 0&&s.onStart(h,o,a),r=!0},this.itemEnd=function(h){o++,s.onProgress!==void 0&&s.onProgress(h,o,a),o===a&&(r=!1,s.onLoad!==void 0&&s.onLoad())},this.itemError=function(h){s.onError!==void 0&&s.onError(h)},this.resolveURL=function(h){return c?c(h):h},this.setURLModifier=function(h){return c=h,this},this.addHandler=function(h,u){return l.push(h,u),this},this.removeHandler=function(h){let u=l.indexOf(h);return u!==-1&&l.splice(u,2),this},this.getHandler=function(h){for(let u=0,d=l.length;u<d;u+=2){let f=l[u],g=l[u+1];if(f.global&&(f.lastIndex=0),f.test(h))return g}return null},this.abort=function(){return this.abortController.abort(),this.abortController=new AbortController,this}}},hm=new gl,_l=class{constructor(t){this.manager=t!==void 0?t:hm,this.crossOrigin="anonymous",this.withCredentials=!1,this.path="",this.resourcePath="",this.requestHeader={}}load(){}loadAsync(t,e){let n=this;return new Promise(function(s,r){n.load(t,s,e,r)})}parse(){}setCrossOrigin(t){return this.crossOrigin=t,this}setWithCredentials(t){return this.withCredentials=t,this}setPath(t){return this.path=t,this}setResourcePath(t){return this.resourcePath=t,this}setRequestHeader(t){return this.requestHeader=t,this}abort(){return this}};_l.DEFAULT_MATERIAL_NAME="__DEFAULT";var xl=class extends Bo{constructor(t=-1,e=1,n=1,s=-1,r=.1,o=2e3){super(),this.isOrthographicCamera=!0,this.type="OrthographicCamera",this.zoom=1,this.view=null,this.left=t,this.right=e,this.top=n,this.bottom=s,this.near=r,this.far=o,this.updateProjectionMatrix()}copy(t,e){return super.copy(t,e),this.left=t.left,this.right=t.right,this.top=t.top,this.bottom=t.bottom,this.near=t.near,this.far=t.far,this.zoom=t.zoom,this.view=t.view===null?null:Object.assign({},t.view),this}setViewOffset(t,e,n,s,r,o){this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=t,this.view.fullHeight=e,this.view.offsetX=n,this.view.offsetY=s,this.view.width=r,this.view.height=o,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let t=(this.right-this.left)/(2*this.zoom),e=(this.top-this.bottom)/(2*this.zoom),n=(this.right+this.left)/2,s=(this.top+this.bottom)/2,r=n-t,o=n+t,a=s+e,c=s-e;if(this.view!==null&&this.view.enabled){let l=(this.right-this.left)/this.view.fullWidth/this.zoom,h=(this.top-this.bottom)/this.view.fullHeight/this.zoom;r+=l*this.view.offsetX,o=r+l*this.view.width,a-=h*this.view.offsetY,c=a-h*this.view.height}this.projectionMatrix.makeOrthographic(r,o,a,c,this.near,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(t){let e=super.toJSON(t);return e.object.zoom=this.zoom,e.object.left=this.left,e.object.right=this.right,e.object.top=this.top,e.object.bottom=this.bottom,e.object.near=this.near,e.object.far=this.far,this.view!==null&&(e.object.view=Object.assign({},this.view)),e}};var yl=class extends wn{constructor(t=[]){super(),this.isArrayCamera=!0,this.isMultiViewCamera=!1,this.cameras=t}};var du="\\[\\]\\.:\\/",Lx=new RegExp("["+du+"]","g"),fu="[^"+du+"]",Dx="[^"+du.replace("\\.","")+"]",Nx=/((?:WC+[\/:])*)/.source.replace("WC",fu),Ux=/(WCOD+)?/.source.replace("WCOD",Dx),Fx=/(?:\.(WC+)(?:\[(.+)\])?)?/.source.replace("WC",fu),Ox=/\.(WC+)(?:\[(.+)\])?/.source.replace("WC",fu),Bx=new RegExp("^"+Nx+Ux+Fx+Ox+"$"),kx=["material","materials","bones","map"],Xh=class{constructor(t,e,n){let s=n||Ge.parseTrackName(e);this._targetGroup=t,this._bindings=t.subscribe_(e,s)}getValue(t,e){this.bind();let n=this._targetGroup.nCachedObjects_,s=this._bindings[n];s!==void 0&&s.getValue(t,e)}setValue(t,e){let n=this._bindings;for(let s=this._targetGroup.nCachedObjects_,r=n.length;s!==r;++s)n[s].setValue(t,e)}bind(){let t=this._bindings;for(let e=this._targetGroup.nCachedObjects_,n=t.length;e!==n;++e)t[e].bind()}unbind(){let t=this._bindings;for(let e=this._targetGroup.nCachedObjects_,n=t.length;e!==n;++e)t[e].unbind()}},Ge=class i{constructor(t,e,n){this.path=e,this.parsedPath=n||i.parseTrackName(e),this.node=i.findNode(t,this.parsedPath.nodeName),this.rootNode=t,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}static create(t,e,n){return t&&t.isAnimationObjectGroup?new i.Composite(t,e,n):new i(t,e,n)}static sanitizeNodeName(t){return t.replace(/\s/g,"_").replace(Lx,"")}static parseTrackName(t){let e=Bx.exec(t);if(e===null)throw new Error("PropertyBinding: Cannot parse trackName: "+t);let n={nodeName:e[2],objectName:e[3],objectIndex:e[4],propertyName:e[5],propertyIndex:e[6]},s=n.nodeName&&n.nodeName.lastIndexOf(".");if(s!==void 0&&s!==-1){let r=n.nodeName.substring(s+1);kx.indexOf(r)!==-1&&(n.nodeName=n.nodeName.substring(0,s),n.objectName=r)}if(n.propertyName===null||n.propertyName.length===0)throw new Error("PropertyBinding: can not parse propertyName from trackName: "+t);return n}static findNode(t,e){if(e===void 0||e===""||e==="."||e===-1||e===t.name||e===t.uuid)return t;if(t.skeleton){let n=t.skeleton.getBoneByName(e);if(n!==void 0)return n}if(t.children){let n=function(r){for(let o=0;o<r.length;o++){let a=r[o];if(a.name===e||a.uuid===e)return a;let c=n(a.children);if(c)return c}return null},s=n(t.children);if(s)return s}return null}_getValue_unavailable(){}_setValue_unavailable(){}_getValue_direct(t,e){t[e]=this.targetObject[this.propertyName]}_getValue_array(t,e){let n=this.resolvedProperty;for(let s=0,r=n.length;s!==r;++s)t[e++]=n[s]}_getValue_arrayElement(t,e){t[e]=this.resolvedProperty[this.propertyIndex]}_getValue_toArray(t,e){this.resolvedProperty.toArray(t,e)}_setValue_direct(t,e){this.targetObject[this.propertyName]=t[e]}_setValue_direct_setNeedsUpdate(t,e){this.targetObject[this.propertyName]=t[e],this.targetObject.needsUpdate=!0}_setValue_direct_setMatrixWorldNeedsUpdate(t,e){this.targetObject[this.propertyName]=t[e],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_array(t,e){let n=this.resolvedProperty;for(let s=0,r=n.length;s!==r;++s)n[s]=t[e++]}_setValue_array_setNeedsUpdate(t,e){let n=this.resolvedProperty;for(let s=0,r=n.length;s!==r;++s)n[s]=t[e++];this.targetObject.needsUpdate=!0}_setValue_array_setMatrixWorldNeedsUpdate(t,e){let n=this.resolvedProperty;for(let s=0,r=n.length;s!==r;++s)n[s]=t[e++];this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_arrayElement(t,e){this.resolvedProperty[this.propertyIndex]=t[e]}_setValue_arrayElement_setNeedsUpdate(t,e){this.resolvedProperty[this.propertyIndex]=t[e],this.targetObject.needsUpdate=!0}_setValue_arrayElement_setMatrixWorldNeedsUpdate(t,e){this.resolvedProperty[this.propertyIndex]=t[e],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_fromArray(t,e){this.resolvedProperty.fromArray(t,e)}_setValue_fromArray_setNeedsUpdate(t,e){this.resolvedProperty.fromArray(t,e),this.targetObject.needsUpdate=!0}_setValue_fromArray_setMatrixWorldNeedsUpdate(t,e){this.resolvedProperty.fromArray(t,e),this.targetObject.matrixWorldNeedsUpdate=!0}_getValue_unbound(t,e){this.bind(),this.getValue(t,e)}_setValue_unbound(t,e){this.bind(),this.setValue(t,e)}bind(){let t=this.node,e=this.parsedPath,n=e.objectName,s=e.propertyName,r=e.propertyIndex;if(t||(t=i.findNode(this.rootNode,e.nodeName),this.node=t),this.getValue=this._getValue_unavailable,this.setValue=this._setValue_unavailable,!t){console.warn("THREE.PropertyBinding: No target node found for track: "+this.path+".");return}if(n){let l=e.objectIndex;switch(n){case"materials":if(!t.material){console.error("THREE.PropertyBinding: Can not bind to material as node does not have a material.",this);return}if(!t.material.materials){console.error("THREE.PropertyBinding: Can not bind to material.materials as node.material does not have a materials array.",this);return}t=t.material.materials;break;case"bones":if(!t.skeleton){console.error("THREE.PropertyBinding: Can not bind to bones as node does not have a skeleton.",this);return}t=t.skeleton.bones;for(let h=0;h<t.length;h++)if(t[h].name===l){l=h;break}break;case"map":if("map"in t){t=t.map;break}if(!t.material){console.error("THREE.PropertyBinding: Can not bind to material as node does not have a material.",this);return}if(!t.material.map){console.error("THREE.PropertyBinding: Can not bind to material.map as node.material does not have a map.",this);return}t=t.material.map;break;default:if(t[n]===void 0){console.error("THREE.PropertyBinding: Can not bind to objectName of node undefined.",this);return}t=t[n]}if(l!==void 0){if(t[l]===void 0){console.error("THREE.PropertyBinding: Trying to bind to objectIndex of objectName, but is undefined.",this,t);return}t=t[l]}}let o=t[s];if(o===void 0){let l=e.nodeName;console.error("THREE.PropertyBinding: Trying to update property for track: "+l+"."+s+" but it wasn't found.",t);return}let a=this.Versioning.None;this.targetObject=t,t.isMaterial===!0?a=this.Versioning.NeedsUpdate:t.isObject3D===!0&&(a=this.Versioning.MatrixWorldNeedsUpdate);let c=this.BindingType.Direct;if(r!==void 0){if(s==="morphTargetInfluences"){if(!t.geometry){console.error("THREE.PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.",this);return}if(!t.geometry.morphAttributes){console.error("THREE.PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.morphAttributes.",this);return}t.morphTargetDictionary[r]!==void 0&&(r=t.morphTargetDictionary[r])}c=this.BindingType.ArrayElement,this.resolvedProperty=o,this.propertyIndex=r}else o.fromArray!==void 0&&o.toArray!==void 0?(c=this.BindingType.HasFromToArray,this.resolvedProperty=o):Array.isArray(o)?(c=this.BindingType.EntireArray,this.resolvedProperty=o):this.propertyName=s;this.getValue=this.GetterByBindingType[c],this.setValue=this.SetterByBindingTypeAndVersioning[c][a]}unbind(){this.node=null,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}};Ge.Composite=Xh;Ge.prototype.BindingType={Direct:0,EntireArray:1,ArrayElement:2,HasFromToArray:3};Ge.prototype.Versioning={None:0,NeedsUpdate:1,MatrixWorldNeedsUpdate:2};Ge.prototype.GetterByBindingType=[Ge.prototype._getValue_direct,Ge.prototype._getValue_array,Ge.prototype._getValue_arrayElement,Ge.prototype._getValue_toArray];Ge.prototype.SetterByBindingTypeAndVersioning=[[Ge.prototype._setValue_direct,Ge.prototype._setValue_direct_setNeedsUpdate,Ge.prototype._setValue_direct_setMatrixWorldNeedsUpdate],[Ge.prototype._setValue_array,Ge.prototype._setValue_array_setNeedsUpdate,Ge.prototype._setValue_array_setMatrixWorldNeedsUpdate],[Ge.prototype._setValue_arrayElement,Ge.prototype._setValue_arrayElement_setNeedsUpdate,Ge.prototype._setValue_arrayElement_setMatrixWorldNeedsUpdate],[Ge.prototype._setValue_fromArray,Ge.prototype._setValue_fromArray_setNeedsUpdate,Ge.prototype._setValue_fromArray_setMatrixWorldNeedsUpdate]];var Iw=new Float32Array(1);var Ss=class{constructor(t=1,e=0,n=0){this.radius=t,this.phi=e,this.theta=n}set(t,e,n){return this.radius=t,this.phi=e,this.theta=n,this}copy(t){return this.radius=t.radius,this.phi=t.phi,this.theta=t.theta,this}makeSafe(){return this.phi=le(this.phi,1e-6,Math.PI-1e-6),this}setFromVector3(t){return this.setFromCartesianCoords(t.x,t.y,t.z)}setFromCartesianCoords(t,e,n){return this.radius=Math.sqrt(t*t+e*e+n*n),this.radius===0?(this.theta=0,this.phi=0):(this.theta=Math.atan2(t,n),this.phi=Math.acos(le(e/this.radius,-1,1))),this}clone(){return new this.constructor().copy(this)}};var $o=class extends Pi{constructor(t,e=null){super(),this.object=t,this.domElement=e,this.enabled=!0,this.state=-1,this.keys={},this.mouseButtons={LEFT:null,MIDDLE:null,RIGHT:null},this.touches={ONE:null,TWO:null}}connect(t){if(t===void 0){console.warn("THREE.Controls: connect() now requires an element.");return}this.domElement!==null&&this.disconnect(),this.domElement=t}disconnect(){}dispose(){}update(){}};function pu(i,t,e,n){let s=zx(n);switch(e){case iu:return i*t;case Dl:return i*t/s.components*s.byteLength;case Nl:return i*t/s.components*s.byteLength;case ru:return i*t*2/s.components*s.byteLength;case Ul:return i*t*2/s.components*s.byteLength;case su:return i*t*3/s.components*s.byteLength;case li:return i*t*4/s.components*s.byteLength;case Fl:return i*t*4/s.components*s.byteLength;case Ko:case jo:return Math.floor((i+3)/4)*Math.floor((t+3)/4)*8;case Qo:case ta:return Math.floor((i+3)/4)*Math.floor((t+3)/4)*16;case Bl:case zl:return Math.max(i,16)*Math.max(t,8)/4;case Ol:case kl:return Math.max(i,8)*Math.max(t,8)/2;case Vl:case Hl:return Math.floor((i+3)/4)*Math.floor((t+3)/4)*8;case Gl:return Math.floor((i+3)/4)*Math.floor((t+3)/4)*16;case Wl:return Math.floor((i+3)/4)*Math.floor((t+3)/4)*16;case Xl:return Math.floor((i+4)/5)*Math.floor((t+3)/4)*16;case ql:return Math.floor((i+4)/5)*Math.floor((t+4)/5)*16;case Yl:return Math.floor((i+5)/6)*Math.floor((t+4)/5)*16;case $l:return Math.floor((i+5)/6)*Math.floor((t+5)/6)*16;case Zl:return Math.floor((i+7)/8)*Math.floor((t+4)/5)*16;case Jl:return Math.floor((i+7)/8)*Math.floor((t+5)/6)*16;case Kl:return Math.floor((i+7)/8)*Math.floor((t+7)/8)*16;case jl:return Math.floor((i+9)/10)*Math.floor((t+4)/5)*16;case Ql:return Math.floor((i+9)/10)*Math.floor((t+5)/6)*16;case tc:return Math.floor((i+9)/10)*Math.floor((t+7)/8)*16;case ec:return Math.floor((i+9)/10)*Math.floor((t+9)/10)*16;case nc:return Math.floor((i+11)/12)*Math.floor((t+9)/10)*16;case ic:return Math.floor((i+11)/12)*Math.floor((t+11)/12)*16;case sc:case rc:case oc:return Math.ceil(i/4)*Math.ceil(t/4)*16;case ac:case lc:return Math.ceil(i/4)*Math.ceil(t/4)*8;case cc:case hc:return Math.ceil(i/4)*Math.ceil(t/4)*16}throw new Error(`Unable to determine texture byte length for ${e} format.`)}function zx(i){switch(i){case Ni:case Qh:return{byteLength:1,components:1};case Zr:case tu:case Jr:return{byteLength:2,components:1};case Il:case Ll:return{byteLength:2,components:4};case As:case Pl:case bi:return{byteLength:4,components:1};case eu:case nu:return{byteLength:4,components:3}}throw new Error(`Unknown texture type ${i}.`)}typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("register",{detail:{revision:"180"}}));typeof window<"u"&&(window.__THREE__?console.warn("WARNING: Multiple instances of Three.js being imported."):window.__THREE__="180");function Nm(){let i=null,t=!1,e=null,n=null;function s(r,o){e(r,o),n=i.requestAnimationFrame(s)}return{start:function(){t!==!0&&e!==null&&(n=i.requestAnimationFrame(s),t=!0)},stop:function(){i.cancelAnimationFrame(n),t=!1},setAnimationLoop:function(r){e=r},setContext:function(r){i=r}}}function Xx(i){let t=new WeakMap;function e(a,c){let l=a.array,h=a.usage,u=l.byteLength,d=i.createBuffer();i.bindBuffer(c,d),i.bufferData(c,l,h),a.onUploadCallback();let f;if(l instanceof Float32Array)f=i.FLOAT;else if(typeof Float16Array<"u"&&l instanceof Float16Array)f=i.HALF_FLOAT;else if(l instanceof Uint16Array)a.isFloat16BufferAttribute?f=i.HALF_FLOAT:f=i.UNSIGNED_SHORT;else if(l instanceof Int16Array)f=i.SHORT;else if(l instanceof Uint32Array)f=i.UNSIGNED_INT;else if(l instanceof Int32Array)f=i.INT;else if(l instanceof Int8Array)f=i.BYTE;else if(l instanceof Uint8Array)f=i.UNSIGNED_BYTE;else if(l instanceof Uint8ClampedArray)f=i.UNSIGNED_BYTE;else throw new Error("THREE.WebGLAttributes: Unsupported buffer data format: "+l);return{buffer:d,type:f,bytesPerElement:l.BYTES_PER_ELEMENT,version:a.version,size:u}}function n(a,c,l){let h=c.array,u=c.updateRanges;if(i.bindBuffer(l,a),u.length===0)i.bufferSubData(l,0,h);else{u.sort((f,g)=>f.start-g.start);let d=0;for(let f=1;f<u.length;f++){let g=u[d],x=u[f];x.start<=g.start+g.count+1?g.count=Math.max(g.count,x.start+x.count-g.start):(++d,u[d]=x)}u.length=d+1;for(let f=0,g=u.length;f<g;f++){let x=u[f];i.bufferSubData(l,x.start*h.BYTES_PER_ELEMENT,h,x.start,x.count)}c.clearUpdateRanges()}c.onUploadCallback()}function s(a){return a.isInterleavedBufferAttribute&&(a=a.data),t.get(a)}function r(a){a.isInterleavedBufferAttribute&&(a=a.data);let c=t.get(a);c&&(i.deleteBuffer(c.buffer),t.delete(a))}function o(a,c){if(a.isInterleavedBufferAttribute&&(a=a.data),a.isGLBufferAttribute){let h=t.get(a);(!h||h.version<a.version)&&t.set(a,{buffer:a.buffer,type:a.type,bytesPerElement:a.elementSize,version:a.version});return}let l=t.get(a);if(l===void 0)t.set(a,e(a,c));else if(l.version<a.version){if(l.size!==a.array.byteLength)throw new Error("THREE.WebGLAttributes: The size of the buffer attribute's array buffer does not match the original size. Resizing buffer attributes is not supported.");n(l.buffer,a,c),l.version=a.version}}return{get:s,remove:r,update:o}}var qx=`#ifdef USE_ALPHAHASH
	if ( diffuseColor.a < getAlphaHashThreshold( vPosition ) ) discard;
#endif`,Yx=`#ifdef USE_ALPHAHASH
	const float ALPHA_HASH_SCALE = 0.05;
	float hash2D( vec2 value ) {
		return fract( 1.0e4 * sin( 17.0 * value.x + 0.1 * value.y ) * ( 0.1 + abs( sin( 13.0 * value.y + value.x ) ) ) );
	}
	float hash3D( vec3 value ) {
		return hash2D( vec2( hash2D( value.xy ), value.z ) );
	}
	float getAlphaHashThreshold( vec3 position ) {
		float maxDeriv = max(
			length( dFdx( position.xyz ) ),
			length( dFdy( position.xyz ) )
		);
		float pixScale = 1.0 / ( ALPHA_HASH_SCALE * maxDeriv );
		vec2 pixScales = vec2(
			exp2( floor( log2( pixScale ) ) ),
			exp2( ceil( log2( pixScale ) ) )
		);
		vec2 alpha = vec2(
			hash3D( floor( pixScales.x * position.xyz ) ),
			hash3D( floor( pixScales.y * position.xyz ) )
		);
		float lerpFactor = fract( log2( pixScale ) );
		float x = ( 1.0 - lerpFactor ) * alpha.x + lerpFactor * alpha.y;
		float a = min( lerpFactor, 1.0 - lerpFactor );
		vec3 cases = vec3(
			x * x / ( 2.0 * a * ( 1.0 - a ) ),
			( x - 0.5 * a ) / ( 1.0 - a ),
			1.0 - ( ( 1.0 - x ) * ( 1.0 - x ) / ( 2.0 * a * ( 1.0 - a ) ) )
		);
		float threshold = ( x < ( 1.0 - a ) )
			? ( ( x < a ) ? cases.x : cases.y )
			: cases.z;
		return clamp( threshold , 1.0e-6, 1.0 );
	}
#endif`,$x=`#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, vAlphaMapUv ).g;
#endif`,Zx=`#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,Jx=`#ifdef USE_ALPHATEST
	#ifdef ALPHA_TO_COVERAGE
	diffuseColor.a = smoothstep( alphaTest, alphaTest + fwidth( diffuseColor.a ), diffuseColor.a );
	if ( diffuseColor.a == 0.0 ) discard;
	#else
	if ( diffuseColor.a < alphaTest ) discard;
	#endif
#endif`,Kx=`#ifdef USE_ALPHATEST
	uniform float alphaTest;
#endif`,jx=`#ifdef USE_AOMAP
	float ambientOcclusion = ( texture2D( aoMap, vAoMapUv ).r - 1.0 ) * aoMapIntensity + 1.0;
	reflectedLight.indirectDiffuse *= ambientOcclusion;
	#if defined( USE_CLEARCOAT ) 
		clearcoatSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_SHEEN ) 
		sheenSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_ENVMAP ) && defined( STANDARD )
		float dotNV = saturate( dot( geometryNormal, geometryViewDir ) );
		reflectedLight.indirectSpecular *= computeSpecularOcclusion( dotNV, ambientOcclusion, material.roughness );
	#endif
#endif`,Qx=`#ifdef USE_AOMAP
	uniform sampler2D aoMap;
	uniform float aoMapIntensity;
#endif`,ty=`#ifdef USE_BATCHING
	#if ! defined( GL_ANGLE_multi_draw )
	#define gl_DrawID _gl_DrawID
	uniform int _gl_DrawID;
	#endif
	uniform highp sampler2D batchingTexture;
	uniform highp usampler2D batchingIdTexture;
	mat4 getBatchingMatrix( const in float i ) {
		int size = textureSize( batchingTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( batchingTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( batchingTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( batchingTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( batchingTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
	float getIndirectIndex( const in int i ) {
		int size = textureSize( batchingIdTexture, 0 ).x;
		int x = i % size;
		int y = i / size;
		return float( texelFetch( batchingIdTexture, ivec2( x, y ), 0 ).r );
	}
#endif
#ifdef USE_BATCHING_COLOR
	uniform sampler2D batchingColorTexture;
	vec3 getBatchingColor( const in float i ) {
		int size = textureSize( batchingColorTexture, 0 ).x;
		int j = int( i );
		int x = j % size;
		int y = j / size;
		return texelFetch( batchingColorTexture, ivec2( x, y ), 0 ).rgb;
	}
#endif`,ey=`#ifdef USE_BATCHING
	mat4 batchingMatrix = getBatchingMatrix( getIndirectIndex( gl_DrawID ) );
#endif`,ny=`vec3 transformed = vec3( position );
#ifdef USE_ALPHAHASH
	vPosition = vec3( position );
#endif`,iy=`vec3 objectNormal = vec3( normal );
#ifdef USE_TANGENT
	vec3 objectTangent = vec3( tangent.xyz );
#endif`,sy=`float G_BlinnPhong_Implicit( ) {
	return 0.25;
}
float D_BlinnPhong( const in float shininess, const in float dotNH ) {
	return RECIPROCAL_PI * ( shininess * 0.5 + 1.0 ) * pow( dotNH, shininess );
}
vec3 BRDF_BlinnPhong( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in vec3 specularColor, const in float shininess ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( specularColor, 1.0, dotVH );
	float G = G_BlinnPhong_Implicit( );
	float D = D_BlinnPhong( shininess, dotNH );
	return F * ( G * D );
} // validated`,ry=`#ifdef USE_IRIDESCENCE
	const mat3 XYZ_TO_REC709 = mat3(
		 3.2404542, -0.9692660,  0.0556434,
		-1.5371385,  1.8760108, -0.2040259,
		-0.4985314,  0.0415560,  1.0572252
	);
	vec3 Fresnel0ToIor( vec3 fresnel0 ) {
		vec3 sqrtF0 = sqrt( fresnel0 );
		return ( vec3( 1.0 ) + sqrtF0 ) / ( vec3( 1.0 ) - sqrtF0 );
	}
	vec3 IorToFresnel0( vec3 transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - vec3( incidentIor ) ) / ( transmittedIor + vec3( incidentIor ) ) );
	}
	float IorToFresnel0( float transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - incidentIor ) / ( transmittedIor + incidentIor ));
	}
	vec3 evalSensitivity( float OPD, vec3 shift ) {
		float phase = 2.0 * PI * OPD * 1.0e-9;
		vec3 val = vec3( 5.4856e-13, 4.4201e-13, 5.2481e-13 );
		vec3 pos = vec3( 1.6810e+06, 1.7953e+06, 2.2084e+06 );
		vec3 var = vec3( 4.3278e+09, 9.3046e+09, 6.6121e+09 );
		vec3 xyz = val * sqrt( 2.0 * PI * var ) * cos( pos * phase + shift ) * exp( - pow2( phase ) * var );
		xyz.x += 9.7470e-14 * sqrt( 2.0 * PI * 4.5282e+09 ) * cos( 2.2399e+06 * phase + shift[ 0 ] ) * exp( - 4.5282e+09 * pow2( phase ) );
		xyz /= 1.0685e-7;
		vec3 rgb = XYZ_TO_REC709 * xyz;
		return rgb;
	}
	vec3 evalIridescence( float outsideIOR, float eta2, float cosTheta1, float thinFilmThickness, vec3 baseF0 ) {
		vec3 I;
		float iridescenceIOR = mix( outsideIOR, eta2, smoothstep( 0.0, 0.03, thinFilmThickness ) );
		float sinTheta2Sq = pow2( outsideIOR / iridescenceIOR ) * ( 1.0 - pow2( cosTheta1 ) );
		float cosTheta2Sq = 1.0 - sinTheta2Sq;
		if ( cosTheta2Sq < 0.0 ) {
			return vec3( 1.0 );
		}
		float cosTheta2 = sqrt( cosTheta2Sq );
		float R0 = IorToFresnel0( iridescenceIOR, outsideIOR );
		float R12 = F_Schlick( R0, 1.0, cosTheta1 );
		float T121 = 1.0 - R12;
		float phi12 = 0.0;
		if ( iridescenceIOR < outsideIOR ) phi12 = PI;
		float phi21 = PI - phi12;
		vec3 baseIOR = Fresnel0ToIor( clamp( baseF0, 0.0, 0.9999 ) );		vec3 R1 = IorToFresnel0( baseIOR, iridescenceIOR );
		vec3 R23 = F_Schlick( R1, 1.0, cosTheta2 );
		vec3 phi23 = vec3( 0.0 );
		if ( baseIOR[ 0 ] < iridescenceIOR ) phi23[ 0 ] = PI;
		if ( baseIOR[ 1 ] < iridescenceIOR ) phi23[ 1 ] = PI;
		if ( baseIOR[ 2 ] < iridescenceIOR ) phi23[ 2 ] = PI;
		float OPD = 2.0 * iridescenceIOR * thinFilmThickness * cosTheta2;
		vec3 phi = vec3( phi21 ) + phi23;
		vec3 R123 = clamp( R12 * R23, 1e-5, 0.9999 );
		vec3 r123 = sqrt( R123 );
		vec3 Rs = pow2( T121 ) * R23 / ( vec3( 1.0 ) - R123 );
		vec3 C0 = R12 + Rs;
		I = C0;
		vec3 Cm = Rs - T121;
		for ( int m = 1; m <= 2; ++ m ) {
			Cm *= r123;
			vec3 Sm = 2.0 * evalSensitivity( float( m ) * OPD, float( m ) * phi );
			I += Cm * Sm;
		}
		return max( I, vec3( 0.0 ) );
	}
#endif`,oy=`#ifdef USE_BUMPMAP
	uniform sampler2D bumpMap;
	uniform float bumpScale;
	vec2 dHdxy_fwd() {
		vec2 dSTdx = dFdx( vBumpMapUv );
		vec2 dSTdy = dFdy( vBumpMapUv );
		float Hll = bumpScale * texture2D( bumpMap, vBumpMapUv ).x;
		float dBx = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdx ).x - Hll;
		float dBy = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdy ).x - Hll;
		return vec2( dBx, dBy );
	}
	vec3 perturbNormalArb( vec3 surf_pos, vec3 surf_norm, vec2 dHdxy, float faceDirection ) {
		vec3 vSigmaX = normalize( dFdx( surf_pos.xyz ) );
		vec3 vSigmaY = normalize( dFdy( surf_pos.xyz ) );
		vec3 vN = surf_norm;
		vec3 R1 = cross( vSigmaY, vN );
		vec3 R2 = cross( vN, vSigmaX );
		float fDet = dot( vSigmaX, R1 ) * faceDirection;
		vec3 vGrad = sign( fDet ) * ( dHdxy.x * R1 + dHdxy.y * R2 );
		return normalize( abs( fDet ) * surf_norm - vGrad );
	}
#endif`,ay=`#if NUM_CLIPPING_PLANES > 0
	vec4 plane;
	#ifdef ALPHA_TO_COVERAGE
		float distanceToPlane, distanceGradient;
		float clipOpacity = 1.0;
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
			distanceGradient = fwidth( distanceToPlane ) / 2.0;
			clipOpacity *= smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			if ( clipOpacity == 0.0 ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			float unionClipOpacity = 1.0;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
				distanceGradient = fwidth( distanceToPlane ) / 2.0;
				unionClipOpacity *= 1.0 - smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			}
			#pragma unroll_loop_end
			clipOpacity *= 1.0 - unionClipOpacity;
		#endif
		diffuseColor.a *= clipOpacity;
		if ( diffuseColor.a == 0.0 ) discard;
	#else
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			if ( dot( vClipPosition, plane.xyz ) > plane.w ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			bool clipped = true;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				clipped = ( dot( vClipPosition, plane.xyz ) > plane.w ) && clipped;
			}
			#pragma unroll_loop_end
			if ( clipped ) discard;
		#endif
	#endif
#endif`,ly=`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
	uniform vec4 clippingPlanes[ NUM_CLIPPING_PLANES ];
#endif`,cy=`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
#endif`,hy=`#if NUM_CLIPPING_PLANES > 0
	vClipPosition = - mvPosition.xyz;
#endif`,uy=`#if defined( USE_COLOR_ALPHA )
	diffuseColor *= vColor;
#elif defined( USE_COLOR )
	diffuseColor.rgb *= vColor;
#endif`,dy=`#if defined( USE_COLOR_ALPHA )
	varying vec4 vColor;
#elif defined( USE_COLOR )
	varying vec3 vColor;
#endif`,fy=`#if defined( USE_COLOR_ALPHA )
	varying vec4 vColor;
#elif defined( USE_COLOR ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	varying vec3 vColor;
#endif`,py=`#if defined( USE_COLOR_ALPHA )
	vColor = vec4( 1.0 );
#elif defined( USE_COLOR ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	vColor = vec3( 1.0 );
#endif
#ifdef USE_COLOR
	vColor *= color;
#endif
#ifdef USE_INSTANCING_COLOR
	vColor.xyz *= instanceColor.xyz;
#endif
#ifdef USE_BATCHING_COLOR
	vec3 batchingColor = getBatchingColor( getIndirectIndex( gl_DrawID ) );
	vColor.xyz *= batchingColor.xyz;
#endif`,my=`#define PI 3.141592653589793
#define PI2 6.283185307179586
#define PI_HALF 1.5707963267948966
#define RECIPROCAL_PI 0.3183098861837907
#define RECIPROCAL_PI2 0.15915494309189535
#define EPSILON 1e-6
#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
#define whiteComplement( a ) ( 1.0 - saturate( a ) )
float pow2( const in float x ) { return x*x; }
vec3 pow2( const in vec3 x ) { return x*x; }
float pow3( const in float x ) { return x*x*x; }
float pow4( const in float x ) { float x2 = x*x; return x2*x2; }
float max3( const in vec3 v ) { return max( max( v.x, v.y ), v.z ); }
float average( const in vec3 v ) { return dot( v, vec3( 0.3333333 ) ); }
highp float rand( const in vec2 uv ) {
	const highp float a = 12.9898, b = 78.233, c = 43758.5453;
	highp float dt = dot( uv.xy, vec2( a,b ) ), sn = mod( dt, PI );
	return fract( sin( sn ) * c );
}
#ifdef HIGH_PRECISION
	float precisionSafeLength( vec3 v ) { return length( v ); }
#else
	float precisionSafeLength( vec3 v ) {
		float maxComponent = max3( abs( v ) );
		return length( v / maxComponent ) * maxComponent;
	}
#endif
struct IncidentLight {
	vec3 color;
	vec3 direction;
	bool visible;
};
struct ReflectedLight {
	vec3 directDiffuse;
	vec3 directSpecular;
	vec3 indirectDiffuse;
	vec3 indirectSpecular;
};
#ifdef USE_ALPHAHASH
	varying vec3 vPosition;
#endif
vec3 transformDirection( in vec3 dir, in mat4 matrix ) {
	return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );
}
vec3 inverseTransformDirection( in vec3 dir, in mat4 matrix ) {
	return normalize( ( vec4( dir, 0.0 ) * matrix ).xyz );
}
mat3 transposeMat3( const in mat3 m ) {
	mat3 tmp;
	tmp[ 0 ] = vec3( m[ 0 ].x, m[ 1 ].x, m[ 2 ].x );
	tmp[ 1 ] = vec3( m[ 0 ].y, m[ 1 ].y, m[ 2 ].y );
	tmp[ 2 ] = vec3( m[ 0 ].z, m[ 1 ].z, m[ 2 ].z );
	return tmp;
}
bool isPerspectiveMatrix( mat4 m ) {
	return m[ 2 ][ 3 ] == - 1.0;
}
vec2 equirectUv( in vec3 dir ) {
	float u = atan( dir.z, dir.x ) * RECIPROCAL_PI2 + 0.5;
	float v = asin( clamp( dir.y, - 1.0, 1.0 ) ) * RECIPROCAL_PI + 0.5;
	return vec2( u, v );
}
vec3 BRDF_Lambert( const in vec3 diffuseColor ) {
	return RECIPROCAL_PI * diffuseColor;
}
vec3 F_Schlick( const in vec3 f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
}
float F_Schlick( const in float f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
} // validated`,gy=`#ifdef ENVMAP_TYPE_CUBE_UV
	#define cubeUV_minMipLevel 4.0
	#define cubeUV_minTileSize 16.0
	float getFace( vec3 direction ) {
		vec3 absDirection = abs( direction );
		float face = - 1.0;
		if ( absDirection.x > absDirection.z ) {
			if ( absDirection.x > absDirection.y )
				face = direction.x > 0.0 ? 0.0 : 3.0;
			else
				face = direction.y > 0.0 ? 1.0 : 4.0;
		} else {
			if ( absDirection.z > absDirection.y )
				face = direction.z > 0.0 ? 2.0 : 5.0;
			else
				face = direction.y > 0.0 ? 1.0 : 4.0;
		}
		return face;
	}
	vec2 getUV( vec3 direction, float face ) {
		vec2 uv;
		if ( face == 0.0 ) {
			uv = vec2( direction.z, direction.y ) / abs( direction.x );
		} else if ( face == 1.0 ) {
			uv = vec2( - direction.x, - direction.z ) / abs( direction.y );
		} else if ( face == 2.0 ) {
			uv = vec2( - direction.x, direction.y ) / abs( direction.z );
		} else if ( face == 3.0 ) {
			uv = vec2( - direction.z, direction.y ) / abs( direction.x );
		} else if ( face == 4.0 ) {
			uv = vec2( - direction.x, direction.z ) / abs( direction.y );
		} else {
			uv = vec2( direction.x, direction.y ) / abs( direction.z );
		}
		return 0.5 * ( uv + 1.0 );
	}
	vec3 bilinearCubeUV( sampler2D envMap, vec3 direction, float mipInt ) {
		float face = getFace( direction );
		float filterInt = max( cubeUV_minMipLevel - mipInt, 0.0 );
		mipInt = max( mipInt, cubeUV_minMipLevel );
		float faceSize = exp2( mipInt );
		highp vec2 uv = getUV( direction, face ) * ( faceSize - 2.0 ) + 1.0;
		if ( face > 2.0 ) {
			uv.y += faceSize;
			face -= 3.0;
		}
		uv.x += face * faceSize;
		uv.x += filterInt * 3.0 * cubeUV_minTileSize;
		uv.y += 4.0 * ( exp2( CUBEUV_MAX_MIP ) - faceSize );
		uv.x *= CUBEUV_TEXEL_WIDTH;
		uv.y *= CUBEUV_TEXEL_HEIGHT;
		#ifdef texture2DGradEXT
			return texture2DGradEXT( envMap, uv, vec2( 0.0 ), vec2( 0.0 ) ).rgb;
		#else
			return texture2D( envMap, uv ).rgb;
		#endif
	}
	#define cubeUV_r0 1.0
	#define cubeUV_m0 - 2.0
	#define cubeUV_r1 0.8
	#define cubeUV_m1 - 1.0
	#define cubeUV_r4 0.4
	#define cubeUV_m4 2.0
	#define cubeUV_r5 0.305
	#define cubeUV_m5 3.0
	#define cubeUV_r6 0.21
	#define cubeUV_m6 4.0
	float roughnessToMip( float roughness ) {
		float mip = 0.0;
		if ( roughness >= cubeUV_r1 ) {
			mip = ( cubeUV_r0 - roughness ) * ( cubeUV_m1 - cubeUV_m0 ) / ( cubeUV_r0 - cubeUV_r1 ) + cubeUV_m0;
		} else if ( roughness >= cubeUV_r4 ) {
			mip = ( cubeUV_r1 - roughness ) * ( cubeUV_m4 - cubeUV_m1 ) / ( cubeUV_r1 - cubeUV_r4 ) + cubeUV_m1;
		} else if ( roughness >= cubeUV_r5 ) {
			mip = ( cubeUV_r4 - roughness ) * ( cubeUV_m5 - cubeUV_m4 ) / ( cubeUV_r4 - cubeUV_r5 ) + cubeUV_m4;
		} else if ( roughness >= cubeUV_r6 ) {
			mip = ( cubeUV_r5 - roughness ) * ( cubeUV_m6 - cubeUV_m5 ) / ( cubeUV_r5 - cubeUV_r6 ) + cubeUV_m5;
		} else {
			mip = - 2.0 * log2( 1.16 * roughness );		}
		return mip;
	}
	vec4 textureCubeUV( sampler2D envMap, vec3 sampleDir, float roughness ) {
		float mip = clamp( roughnessToMip( roughness ), cubeUV_m0, CUBEUV_MAX_MIP );
		float mipF = fract( mip );
		float mipInt = floor( mip );
		vec3 color0 = bilinearCubeUV( envMap, sampleDir, mipInt );
		if ( mipF == 0.0 ) {
			return vec4( color0, 1.0 );
		} else {
			vec3 color1 = bilinearCubeUV( envMap, sampleDir, mipInt + 1.0 );
			return vec4( mix( color0, color1, mipF ), 1.0 );
		}
	}
#endif`,_y=`vec3 transformedNormal = objectNormal;
#ifdef USE_TANGENT
	vec3 transformedTangent = objectTangent;
#endif
#ifdef USE_BATCHING
	mat3 bm = mat3( batchingMatrix );
	transformedNormal /= vec3( dot( bm[ 0 ], bm[ 0 ] ), dot( bm[ 1 ], bm[ 1 ] ), dot( bm[ 2 ], bm[ 2 ] ) );
	transformedNormal = bm * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = bm * transformedTangent;
	#endif
#endif
#ifdef USE_INSTANCING
	mat3 im = mat3( instanceMatrix );
	transformedNormal /= vec3( dot( im[ 0 ], im[ 0 ] ), dot( im[ 1 ], im[ 1 ] ), dot( im[ 2 ], im[ 2 ] ) );
	transformedNormal = im * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = im * transformedTangent;
	#endif
#endif
transformedNormal = normalMatrix * transformedNormal;
#ifdef FLIP_SIDED
	transformedNormal = - transformedNormal;
#endif
#ifdef USE_TANGENT
	transformedTangent = ( modelViewMatrix * vec4( transformedTangent, 0.0 ) ).xyz;
	#ifdef FLIP_SIDED
		transformedTangent = - transformedTangent;
	#endif
#endif`,xy=`#ifdef USE_DISPLACEMENTMAP
	uniform sampler2D displacementMap;
	uniform float displacementScale;
	uniform float displacementBias;
#endif`,yy=`#ifdef USE_DISPLACEMENTMAP
	transformed += normalize( objectNormal ) * ( texture2D( displacementMap, vDisplacementMapUv ).x * displacementScale + displacementBias );
#endif`,vy=`#ifdef USE_EMISSIVEMAP
	vec4 emissiveColor = texture2D( emissiveMap, vEmissiveMapUv );
	#ifdef DECODE_VIDEO_TEXTURE_EMISSIVE
		emissiveColor = sRGBTransferEOTF( emissiveColor );
	#endif
	totalEmissiveRadiance *= emissiveColor.rgb;
#endif`,My=`#ifdef USE_EMISSIVEMAP
	uniform sampler2D emissiveMap;
#endif`,by="gl_FragColor = linearToOutputTexel( gl_FragColor );",Sy=`vec4 LinearTransferOETF( in vec4 value ) {
	return value;
}
vec4 sRGBTransferEOTF( in vec4 value ) {
	return vec4( mix( pow( value.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), value.rgb * 0.0773993808, vec3( lessThanEqual( value.rgb, vec3( 0.04045 ) ) ) ), value.a );
}
vec4 sRGBTransferOETF( in vec4 value ) {
	return vec4( mix( pow( value.rgb, vec3( 0.41666 ) ) * 1.055 - vec3( 0.055 ), value.rgb * 12.92, vec3( lessThanEqual( value.rgb, vec3( 0.0031308 ) ) ) ), value.a );
}`,wy=`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vec3 cameraToFrag;
		if ( isOrthographic ) {
			cameraToFrag = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToFrag = normalize( vWorldPosition - cameraPosition );
		}
		vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vec3 reflectVec = reflect( cameraToFrag, worldNormal );
		#else
			vec3 reflectVec = refract( cameraToFrag, worldNormal, refractionRatio );
		#endif
	#else
		vec3 reflectVec = vReflect;
	#endif
	#ifdef ENVMAP_TYPE_CUBE
		vec4 envColor = textureCube( envMap, envMapRotation * vec3( flipEnvMap * reflectVec.x, reflectVec.yz ) );
	#else
		vec4 envColor = vec4( 0.0 );
	#endif
	#ifdef ENVMAP_BLENDING_MULTIPLY
		outgoingLight = mix( outgoingLight, outgoingLight * envColor.xyz, specularStrength * reflectivity );
	#elif defined( ENVMAP_BLENDING_MIX )
		outgoingLight = mix( outgoingLight, envColor.xyz, specularStrength * reflectivity );
	#elif defined( ENVMAP_BLENDING_ADD )
		outgoingLight += envColor.xyz * specularStrength * reflectivity;
	#endif
#endif`,Ey=`#ifdef USE_ENVMAP
	uniform float envMapIntensity;
	uniform float flipEnvMap;
	uniform mat3 envMapRotation;
	#ifdef ENVMAP_TYPE_CUBE
		uniform samplerCube envMap;
	#else
		uniform sampler2D envMap;
	#endif
	
#endif`,Ty=`#ifdef USE_ENVMAP
	uniform float reflectivity;
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		varying vec3 vWorldPosition;
		uniform float refractionRatio;
	#else
		varying vec3 vReflect;
	#endif
#endif`,Ay=`#ifdef USE_ENVMAP
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		
		varying vec3 vWorldPosition;
	#else
		varying vec3 vReflect;
		uniform float refractionRatio;
	#endif
#endif`,Ry=`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vWorldPosition = worldPosition.xyz;
	#else
		vec3 cameraToVertex;
		if ( isOrthographic ) {
			cameraToVertex = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToVertex = normalize( worldPosition.xyz - cameraPosition );
		}
		vec3 worldNormal = inverseTransformDirection( transformedNormal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vReflect = reflect( cameraToVertex, worldNormal );
		#else
			vReflect = refract( cameraToVertex, worldNormal, refractionRatio );
		#endif
	#endif
#endif`,Cy=`#ifdef USE_FOG
	vFogDepth = - mvPosition.z;
#endif`,Py=`#ifdef USE_FOG
	varying float vFogDepth;
#endif`,Iy=`#ifdef USE_FOG
	#ifdef FOG_EXP2
		float fogFactor = 1.0 - exp( - fogDensity * fogDensity * vFogDepth * vFogDepth );
	#else
		float fogFactor = smoothstep( fogNear, fogFar, vFogDepth );
	#endif
	gl_FragColor.rgb = mix( gl_FragColor.rgb, fogColor, fogFactor );
#endif`,Ly=`#ifdef USE_FOG
	uniform vec3 fogColor;
	varying float vFogDepth;
	#ifdef FOG_EXP2
		uniform float fogDensity;
	#else
		uniform float fogNear;
		uniform float fogFar;
	#endif
#endif`,Dy=`#ifdef USE_GRADIENTMAP
	uniform sampler2D gradientMap;
#endif
vec3 getGradientIrradiance( vec3 normal, vec3 lightDirection ) {
	float dotNL = dot( normal, lightDirection );
	vec2 coord = vec2( dotNL * 0.5 + 0.5, 0.0 );
	#ifdef USE_GRADIENTMAP
		return vec3( texture2D( gradientMap, coord ).r );
	#else
		vec2 fw = fwidth( coord ) * 0.5;
		return mix( vec3( 0.7 ), vec3( 1.0 ), smoothstep( 0.7 - fw.x, 0.7 + fw.x, coord.x ) );
	#endif
}`,Ny=`#ifdef USE_LIGHTMAP
	uniform sampler2D lightMap;
	uniform float lightMapIntensity;
#endif`,Uy=`LambertMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularStrength = specularStrength;`,Fy=`varying vec3 vViewPosition;
struct LambertMaterial {
	vec3 diffuseColor;
	float specularStrength;
};
void RE_Direct_Lambert( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Lambert( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Lambert
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Lambert`,Oy=`uniform bool receiveShadow;
uniform vec3 ambientLightColor;
#if defined( USE_LIGHT_PROBES )
	uniform vec3 lightProbe[ 9 ];
#endif
vec3 shGetIrradianceAt( in vec3 normal, in vec3 shCoefficients[ 9 ] ) {
	float x = normal.x, y = normal.y, z = normal.z;
	vec3 result = shCoefficients[ 0 ] * 0.886227;
	result += shCoefficients[ 1 ] * 2.0 * 0.511664 * y;
	result += shCoefficients[ 2 ] * 2.0 * 0.511664 * z;
	result += shCoefficients[ 3 ] * 2.0 * 0.511664 * x;
	result += shCoefficients[ 4 ] * 2.0 * 0.429043 * x * y;
	result += shCoefficients[ 5 ] * 2.0 * 0.429043 * y * z;
	result += shCoefficients[ 6 ] * ( 0.743125 * z * z - 0.247708 );
	result += shCoefficients[ 7 ] * 2.0 * 0.429043 * x * z;
	result += shCoefficients[ 8 ] * 0.429043 * ( x * x - y * y );
	return result;
}
vec3 getLightProbeIrradiance( const in vec3 lightProbe[ 9 ], const in vec3 normal ) {
	vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
	vec3 irradiance = shGetIrradianceAt( worldNormal, lightProbe );
	return irradiance;
}
vec3 getAmbientLightIrradiance( const in vec3 ambientLightColor ) {
	vec3 irradiance = ambientLightColor;
	return irradiance;
}
float getDistanceAttenuation( const in float lightDistance, const in float cutoffDistance, const in float decayExponent ) {
	float distanceFalloff = 1.0 / max( pow( lightDistance, decayExponent ), 0.01 );
	if ( cutoffDistance > 0.0 ) {
		distanceFalloff *= pow2( saturate( 1.0 - pow4( lightDistance / cutoffDistance ) ) );
	}
	return distanceFalloff;
}
float getSpotAttenuation( const in float coneCosine, const in float penumbraCosine, const in float angleCosine ) {
	return smoothstep( coneCosine, penumbraCosine, angleCosine );
}
#if NUM_DIR_LIGHTS > 0
	struct DirectionalLight {
		vec3 direction;
		vec3 color;
	};
	uniform DirectionalLight directionalLights[ NUM_DIR_LIGHTS ];
	void getDirectionalLightInfo( const in DirectionalLight directionalLight, out IncidentLight light ) {
		light.color = directionalLight.color;
		light.direction = directionalLight.direction;
		light.visible = true;
	}
#endif
#if NUM_POINT_LIGHTS > 0
	struct PointLight {
		vec3 position;
		vec3 color;
		float distance;
		float decay;
	};
	uniform PointLight pointLights[ NUM_POINT_LIGHTS ];
	void getPointLightInfo( const in PointLight pointLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = pointLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float lightDistance = length( lVector );
		light.color = pointLight.color;
		light.color *= getDistanceAttenuation( lightDistance, pointLight.distance, pointLight.decay );
		light.visible = ( light.color != vec3( 0.0 ) );
	}
#endif
#if NUM_SPOT_LIGHTS > 0
	struct SpotLight {
		vec3 position;
		vec3 direction;
		vec3 color;
		float distance;
		float decay;
		float coneCos;
		float penumbraCos;
	};
	uniform SpotLight spotLights[ NUM_SPOT_LIGHTS ];
	void getSpotLightInfo( const in SpotLight spotLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = spotLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float angleCos = dot( light.direction, spotLight.direction );
		float spotAttenuation = getSpotAttenuation( spotLight.coneCos, spotLight.penumbraCos, angleCos );
		if ( spotAttenuation > 0.0 ) {
			float lightDistance = length( lVector );
			light.color = spotLight.color * spotAttenuation;
			light.color *= getDistanceAttenuation( lightDistance, spotLight.distance, spotLight.decay );
			light.visible = ( light.color != vec3( 0.0 ) );
		} else {
			light.color = vec3( 0.0 );
			light.visible = false;
		}
	}
#endif
#if NUM_RECT_AREA_LIGHTS > 0
	struct RectAreaLight {
		vec3 color;
		vec3 position;
		vec3 halfWidth;
		vec3 halfHeight;
	};
	uniform sampler2D ltc_1;	uniform sampler2D ltc_2;
	uniform RectAreaLight rectAreaLights[ NUM_RECT_AREA_LIGHTS ];
#endif
#if NUM_HEMI_LIGHTS > 0
	struct HemisphereLight {
		vec3 direction;
		vec3 skyColor;
		vec3 groundColor;
	};
	uniform HemisphereLight hemisphereLights[ NUM_HEMI_LIGHTS ];
	vec3 getHemisphereLightIrradiance( const in HemisphereLight hemiLight, const in vec3 normal ) {
		float dotNL = dot( normal, hemiLight.direction );
		float hemiDiffuseWeight = 0.5 * dotNL + 0.5;
		vec3 irradiance = mix( hemiLight.groundColor, hemiLight.skyColor, hemiDiffuseWeight );
		return irradiance;
	}
#endif`,By=`#ifdef USE_ENVMAP
	vec3 getIBLIrradiance( const in vec3 normal ) {
		#ifdef ENVMAP_TYPE_CUBE_UV
			vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
			vec4 envMapColor = textureCubeUV( envMap, envMapRotation * worldNormal, 1.0 );
			return PI * envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	vec3 getIBLRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness ) {
		#ifdef ENVMAP_TYPE_CUBE_UV
			vec3 reflectVec = reflect( - viewDir, normal );
			reflectVec = normalize( mix( reflectVec, normal, roughness * roughness) );
			reflectVec = inverseTransformDirection( reflectVec, viewMatrix );
			vec4 envMapColor = textureCubeUV( envMap, envMapRotation * reflectVec, roughness );
			return envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	#ifdef USE_ANISOTROPY
		vec3 getIBLAnisotropyRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness, const in vec3 bitangent, const in float anisotropy ) {
			#ifdef ENVMAP_TYPE_CUBE_UV
				vec3 bentNormal = cross( bitangent, viewDir );
				bentNormal = normalize( cross( bentNormal, bitangent ) );
				bentNormal = normalize( mix( bentNormal, normal, pow2( pow2( 1.0 - anisotropy * ( 1.0 - roughness ) ) ) ) );
				return getIBLRadiance( viewDir, bentNormal, roughness );
			#else
				return vec3( 0.0 );
			#endif
		}
	#endif
#endif`,ky=`ToonMaterial material;
material.diffuseColor = diffuseColor.rgb;`,zy=`varying vec3 vViewPosition;
struct ToonMaterial {
	vec3 diffuseColor;
};
void RE_Direct_Toon( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	vec3 irradiance = getGradientIrradiance( geometryNormal, directLight.direction ) * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Toon( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Toon
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Toon`,Vy=`BlinnPhongMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularColor = specular;
material.specularShininess = shininess;
material.specularStrength = specularStrength;`,Hy=`varying vec3 vViewPosition;
struct BlinnPhongMaterial {
	vec3 diffuseColor;
	vec3 specularColor;
	float specularShininess;
	float specularStrength;
};
void RE_Direct_BlinnPhong( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
	reflectedLight.directSpecular += irradiance * BRDF_BlinnPhong( directLight.direction, geometryViewDir, geometryNormal, material.specularColor, material.specularShininess ) * material.specularStrength;
}
void RE_IndirectDiffuse_BlinnPhong( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_BlinnPhong
#define RE_IndirectDiffuse		RE_IndirectDiffuse_BlinnPhong`,Gy=`PhysicalMaterial material;
material.diffuseColor = diffuseColor.rgb * ( 1.0 - metalnessFactor );
vec3 dxy = max( abs( dFdx( nonPerturbedNormal ) ), abs( dFdy( nonPerturbedNormal ) ) );
float geometryRoughness = max( max( dxy.x, dxy.y ), dxy.z );
material.roughness = max( roughnessFactor, 0.0525 );material.roughness += geometryRoughness;
material.roughness = min( material.roughness, 1.0 );
#ifdef IOR
	material.ior = ior;
	#ifdef USE_SPECULAR
		float specularIntensityFactor = specularIntensity;
		vec3 specularColorFactor = specularColor;
		#ifdef USE_SPECULAR_COLORMAP
			specularColorFactor *= texture2D( specularColorMap, vSpecularColorMapUv ).rgb;
		#endif
		#ifdef USE_SPECULAR_INTENSITYMAP
			specularIntensityFactor *= texture2D( specularIntensityMap, vSpecularIntensityMapUv ).a;
		#endif
		material.specularF90 = mix( specularIntensityFactor, 1.0, metalnessFactor );
	#else
		float specularIntensityFactor = 1.0;
		vec3 specularColorFactor = vec3( 1.0 );
		material.specularF90 = 1.0;
	#endif
	material.specularColor = mix( min( pow2( ( material.ior - 1.0 ) / ( material.ior + 1.0 ) ) * specularColorFactor, vec3( 1.0 ) ) * specularIntensityFactor, diffuseColor.rgb, metalnessFactor );
#else
	material.specularColor = mix( vec3( 0.04 ), diffuseColor.rgb, metalnessFactor );
	material.specularF90 = 1.0;
#endif
#ifdef USE_CLEARCOAT
	material.clearcoat = clearcoat;
	material.clearcoatRoughness = clearcoatRoughness;
	material.clearcoatF0 = vec3( 0.04 );
	material.clearcoatF90 = 1.0;
	#ifdef USE_CLEARCOATMAP
		material.clearcoat *= texture2D( clearcoatMap, vClearcoatMapUv ).x;
	#endif
	#ifdef USE_CLEARCOAT_ROUGHNESSMAP
		material.clearcoatRoughness *= texture2D( clearcoatRoughnessMap, vClearcoatRoughnessMapUv ).y;
	#endif
	material.clearcoat = saturate( material.clearcoat );	material.clearcoatRoughness = max( material.clearcoatRoughness, 0.0525 );
	material.clearcoatRoughness += geometryRoughness;
	material.clearcoatRoughness = min( material.clearcoatRoughness, 1.0 );
#endif
#ifdef USE_DISPERSION
	material.dispersion = dispersion;
#endif
#ifdef USE_IRIDESCENCE
	material.iridescence = iridescence;
	material.iridescenceIOR = iridescenceIOR;
	#ifdef USE_IRIDESCENCEMAP
		material.iridescence *= texture2D( iridescenceMap, vIridescenceMapUv ).r;
	#endif
	#ifdef USE_IRIDESCENCE_THICKNESSMAP
		material.iridescenceThickness = (iridescenceThicknessMaximum - iridescenceThicknessMinimum) * texture2D( iridescenceThicknessMap, vIridescenceThicknessMapUv ).g + iridescenceThicknessMinimum;
	#else
		material.iridescenceThickness = iridescenceThicknessMaximum;
	#endif
#endif
#ifdef USE_SHEEN
	material.sheenColor = sheenColor;
	#ifdef USE_SHEEN_COLORMAP
		material.sheenColor *= texture2D( sheenColorMap, vSheenColorMapUv ).rgb;
	#endif
	material.sheenRoughness = clamp( sheenRoughness, 0.07, 1.0 );
	#ifdef USE_SHEEN_ROUGHNESSMAP
		material.sheenRoughness *= texture2D( sheenRoughnessMap, vSheenRoughnessMapUv ).a;
	#endif
#endif
#ifdef USE_ANISOTROPY
	#ifdef USE_ANISOTROPYMAP
		mat2 anisotropyMat = mat2( anisotropyVector.x, anisotropyVector.y, - anisotropyVector.y, anisotropyVector.x );
		vec3 anisotropyPolar = texture2D( anisotropyMap, vAnisotropyMapUv ).rgb;
		vec2 anisotropyV = anisotropyMat * normalize( 2.0 * anisotropyPolar.rg - vec2( 1.0 ) ) * anisotropyPolar.b;
	#else
		vec2 anisotropyV = anisotropyVector;
	#endif
	material.anisotropy = length( anisotropyV );
	if( material.anisotropy == 0.0 ) {
		anisotropyV = vec2( 1.0, 0.0 );
	} else {
		anisotropyV /= material.anisotropy;
		material.anisotropy = saturate( material.anisotropy );
	}
	material.alphaT = mix( pow2( material.roughness ), 1.0, pow2( material.anisotropy ) );
	material.anisotropyT = tbn[ 0 ] * anisotropyV.x + tbn[ 1 ] * anisotropyV.y;
	material.anisotropyB = tbn[ 1 ] * anisotropyV.x - tbn[ 0 ] * anisotropyV.y;
#endif`,Wy=`struct PhysicalMaterial {
	vec3 diffuseColor;
	float roughness;
	vec3 specularColor;
	float specularF90;
	float dispersion;
	#ifdef USE_CLEARCOAT
		float clearcoat;
		float clearcoatRoughness;
		vec3 clearcoatF0;
		float clearcoatF90;
	#endif
	#ifdef USE_IRIDESCENCE
		float iridescence;
		float iridescenceIOR;
		float iridescenceThickness;
		vec3 iridescenceFresnel;
		vec3 iridescenceF0;
	#endif
	#ifdef USE_SHEEN
		vec3 sheenColor;
		float sheenRoughness;
	#endif
	#ifdef IOR
		float ior;
	#endif
	#ifdef USE_TRANSMISSION
		float transmission;
		float transmissionAlpha;
		float thickness;
		float attenuationDistance;
		vec3 attenuationColor;
	#endif
	#ifdef USE_ANISOTROPY
		float anisotropy;
		float alphaT;
		vec3 anisotropyT;
		vec3 anisotropyB;
	#endif
};
vec3 clearcoatSpecularDirect = vec3( 0.0 );
vec3 clearcoatSpecularIndirect = vec3( 0.0 );
vec3 sheenSpecularDirect = vec3( 0.0 );
vec3 sheenSpecularIndirect = vec3(0.0 );
vec3 Schlick_to_F0( const in vec3 f, const in float f90, const in float dotVH ) {
    float x = clamp( 1.0 - dotVH, 0.0, 1.0 );
    float x2 = x * x;
    float x5 = clamp( x * x2 * x2, 0.0, 0.9999 );
    return ( f - vec3( f90 ) * x5 ) / ( 1.0 - x5 );
}
float V_GGX_SmithCorrelated( const in float alpha, const in float dotNL, const in float dotNV ) {
	float a2 = pow2( alpha );
	float gv = dotNL * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNV ) );
	float gl = dotNV * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNL ) );
	return 0.5 / max( gv + gl, EPSILON );
}
float D_GGX( const in float alpha, const in float dotNH ) {
	float a2 = pow2( alpha );
	float denom = pow2( dotNH ) * ( a2 - 1.0 ) + 1.0;
	return RECIPROCAL_PI * a2 / pow2( denom );
}
#ifdef USE_ANISOTROPY
	float V_GGX_SmithCorrelated_Anisotropic( const in float alphaT, const in float alphaB, const in float dotTV, const in float dotBV, const in float dotTL, const in float dotBL, const in float dotNV, const in float dotNL ) {
		float gv = dotNL * length( vec3( alphaT * dotTV, alphaB * dotBV, dotNV ) );
		float gl = dotNV * length( vec3( alphaT * dotTL, alphaB * dotBL, dotNL ) );
		float v = 0.5 / ( gv + gl );
		return saturate(v);
	}
	float D_GGX_Anisotropic( const in float alphaT, const in float alphaB, const in float dotNH, const in float dotTH, const in float dotBH ) {
		float a2 = alphaT * alphaB;
		highp vec3 v = vec3( alphaB * dotTH, alphaT * dotBH, a2 * dotNH );
		highp float v2 = dot( v, v );
		float w2 = a2 / v2;
		return RECIPROCAL_PI * a2 * pow2 ( w2 );
	}
#endif
#ifdef USE_CLEARCOAT
	vec3 BRDF_GGX_Clearcoat( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material) {
		vec3 f0 = material.clearcoatF0;
		float f90 = material.clearcoatF90;
		float roughness = material.clearcoatRoughness;
		float alpha = pow2( roughness );
		vec3 halfDir = normalize( lightDir + viewDir );
		float dotNL = saturate( dot( normal, lightDir ) );
		float dotNV = saturate( dot( normal, viewDir ) );
		float dotNH = saturate( dot( normal, halfDir ) );
		float dotVH = saturate( dot( viewDir, halfDir ) );
		vec3 F = F_Schlick( f0, f90, dotVH );
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
		return F * ( V * D );
	}
#endif
vec3 BRDF_GGX( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material ) {
	vec3 f0 = material.specularColor;
	float f90 = material.specularF90;
	float roughness = material.roughness;
	float alpha = pow2( roughness );
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( f0, f90, dotVH );
	#ifdef USE_IRIDESCENCE
		F = mix( F, material.iridescenceFresnel, material.iridescence );
	#endif
	#ifdef USE_ANISOTROPY
		float dotTL = dot( material.anisotropyT, lightDir );
		float dotTV = dot( material.anisotropyT, viewDir );
		float dotTH = dot( material.anisotropyT, halfDir );
		float dotBL = dot( material.anisotropyB, lightDir );
		float dotBV = dot( material.anisotropyB, viewDir );
		float dotBH = dot( material.anisotropyB, halfDir );
		float V = V_GGX_SmithCorrelated_Anisotropic( material.alphaT, alpha, dotTV, dotBV, dotTL, dotBL, dotNV, dotNL );
		float D = D_GGX_Anisotropic( material.alphaT, alpha, dotNH, dotTH, dotBH );
	#else
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
	#endif
	return F * ( V * D );
}
vec2 LTC_Uv( const in vec3 N, const in vec3 V, const in float roughness ) {
	const float LUT_SIZE = 64.0;
	const float LUT_SCALE = ( LUT_SIZE - 1.0 ) / LUT_SIZE;
	const float LUT_BIAS = 0.5 / LUT_SIZE;
	float dotNV = saturate( dot( N, V ) );
	vec2 uv = vec2( roughness, sqrt( 1.0 - dotNV ) );
	uv = uv * LUT_SCALE + LUT_BIAS;
	return uv;
}
float LTC_ClippedSphereFormFactor( const in vec3 f ) {
	float l = length( f );
	return max( ( l * l + f.z ) / ( l + 1.0 ), 0.0 );
}
vec3 LTC_EdgeVectorFormFactor( const in vec3 v1, const in vec3 v2 ) {
	float x = dot( v1, v2 );
	float y = abs( x );
	float a = 0.8543985 + ( 0.4965155 + 0.0145206 * y ) * y;
	float b = 3.4175940 + ( 4.1616724 + y ) * y;
	float v = a / b;
	float theta_sintheta = ( x > 0.0 ) ? v : 0.5 * inversesqrt( max( 1.0 - x * x, 1e-7 ) ) - v;
	return cross( v1, v2 ) * theta_sintheta;
}
vec3 LTC_Evaluate( const in vec3 N, const in vec3 V, const in vec3 P, const in mat3 mInv, const in vec3 rectCoords[ 4 ] ) {
	vec3 v1 = rectCoords[ 1 ] - rectCoords[ 0 ];
	vec3 v2 = rectCoords[ 3 ] - rectCoords[ 0 ];
	vec3 lightNormal = cross( v1, v2 );
	if( dot( lightNormal, P - rectCoords[ 0 ] ) < 0.0 ) return vec3( 0.0 );
	vec3 T1, T2;
	T1 = normalize( V - N * dot( V, N ) );
	T2 = - cross( N, T1 );
	mat3 mat = mInv * transposeMat3( mat3( T1, T2, N ) );
	vec3 coords[ 4 ];
	coords[ 0 ] = mat * ( rectCoords[ 0 ] - P );
	coords[ 1 ] = mat * ( rectCoords[ 1 ] - P );
	coords[ 2 ] = mat * ( rectCoords[ 2 ] - P );
	coords[ 3 ] = mat * ( rectCoords[ 3 ] - P );
	coords[ 0 ] = normalize( coords[ 0 ] );
	coords[ 1 ] = normalize( coords[ 1 ] );
	coords[ 2 ] = normalize( coords[ 2 ] );
	coords[ 3 ] = normalize( coords[ 3 ] );
	vec3 vectorFormFactor = vec3( 0.0 );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 0 ], coords[ 1 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 1 ], coords[ 2 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 2 ], coords[ 3 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 3 ], coords[ 0 ] );
	float result = LTC_ClippedSphereFormFactor( vectorFormFactor );
	return vec3( result );
}
#if defined( USE_SHEEN )
float D_Charlie( float roughness, float dotNH ) {
	float alpha = pow2( roughness );
	float invAlpha = 1.0 / alpha;
	float cos2h = dotNH * dotNH;
	float sin2h = max( 1.0 - cos2h, 0.0078125 );
	return ( 2.0 + invAlpha ) * pow( sin2h, invAlpha * 0.5 ) / ( 2.0 * PI );
}
float V_Neubelt( float dotNV, float dotNL ) {
	return saturate( 1.0 / ( 4.0 * ( dotNL + dotNV - dotNL * dotNV ) ) );
}
vec3 BRDF_Sheen( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, vec3 sheenColor, const in float sheenRoughness ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float D = D_Charlie( sheenRoughness, dotNH );
	float V = V_Neubelt( dotNV, dotNL );
	return sheenColor * ( D * V );
}
#endif
float IBLSheenBRDF( const in vec3 normal, const in vec3 viewDir, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	float r2 = roughness * roughness;
	float a = roughness < 0.25 ? -339.2 * r2 + 161.4 * roughness - 25.9 : -8.48 * r2 + 14.3 * roughness - 9.95;
	float b = roughness < 0.25 ? 44.0 * r2 - 23.7 * roughness + 3.26 : 1.97 * r2 - 3.27 * roughness + 0.72;
	float DG = exp( a * dotNV + b ) + ( roughness < 0.25 ? 0.0 : 0.1 * ( roughness - 0.25 ) );
	return saturate( DG * RECIPROCAL_PI );
}
vec2 DFGApprox( const in vec3 normal, const in vec3 viewDir, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	const vec4 c0 = vec4( - 1, - 0.0275, - 0.572, 0.022 );
	const vec4 c1 = vec4( 1, 0.0425, 1.04, - 0.04 );
	vec4 r = roughness * c0 + c1;
	float a004 = min( r.x * r.x, exp2( - 9.28 * dotNV ) ) * r.x + r.y;
	vec2 fab = vec2( - 1.04, 1.04 ) * a004 + r.zw;
	return fab;
}
vec3 EnvironmentBRDF( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float roughness ) {
	vec2 fab = DFGApprox( normal, viewDir, roughness );
	return specularColor * fab.x + specularF90 * fab.y;
}
#ifdef USE_IRIDESCENCE
void computeMultiscatteringIridescence( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float iridescence, const in vec3 iridescenceF0, const in float roughness, inout vec3 singleScatter, inout vec3 multiScatter ) {
#else
void computeMultiscattering( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float roughness, inout vec3 singleScatter, inout vec3 multiScatter ) {
#endif
	vec2 fab = DFGApprox( normal, viewDir, roughness );
	#ifdef USE_IRIDESCENCE
		vec3 Fr = mix( specularColor, iridescenceF0, iridescence );
	#else
		vec3 Fr = specularColor;
	#endif
	vec3 FssEss = Fr * fab.x + specularF90 * fab.y;
	float Ess = fab.x + fab.y;
	float Ems = 1.0 - Ess;
	vec3 Favg = Fr + ( 1.0 - Fr ) * 0.047619;	vec3 Fms = FssEss * Favg / ( 1.0 - Ems * Favg );
	singleScatter += FssEss;
	multiScatter += Fms * Ems;
}
#if NUM_RECT_AREA_LIGHTS > 0
	void RE_Direct_RectArea_Physical( const in RectAreaLight rectAreaLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
		vec3 normal = geometryNormal;
		vec3 viewDir = geometryViewDir;
		vec3 position = geometryPosition;
		vec3 lightPos = rectAreaLight.position;
		vec3 halfWidth = rectAreaLight.halfWidth;
		vec3 halfHeight = rectAreaLight.halfHeight;
		vec3 lightColor = rectAreaLight.color;
		float roughness = material.roughness;
		vec3 rectCoords[ 4 ];
		rectCoords[ 0 ] = lightPos + halfWidth - halfHeight;		rectCoords[ 1 ] = lightPos - halfWidth - halfHeight;
		rectCoords[ 2 ] = lightPos - halfWidth + halfHeight;
		rectCoords[ 3 ] = lightPos + halfWidth + halfHeight;
		vec2 uv = LTC_Uv( normal, viewDir, roughness );
		vec4 t1 = texture2D( ltc_1, uv );
		vec4 t2 = texture2D( ltc_2, uv );
		mat3 mInv = mat3(
			vec3( t1.x, 0, t1.y ),
			vec3(    0, 1,    0 ),
			vec3( t1.z, 0, t1.w )
		);
		vec3 fresnel = ( material.specularColor * t2.x + ( vec3( 1.0 ) - material.specularColor ) * t2.y );
		reflectedLight.directSpecular += lightColor * fresnel * LTC_Evaluate( normal, viewDir, position, mInv, rectCoords );
		reflectedLight.directDiffuse += lightColor * material.diffuseColor * LTC_Evaluate( normal, viewDir, position, mat3( 1.0 ), rectCoords );
	}
#endif
void RE_Direct_Physical( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	#ifdef USE_CLEARCOAT
		float dotNLcc = saturate( dot( geometryClearcoatNormal, directLight.direction ) );
		vec3 ccIrradiance = dotNLcc * directLight.color;
		clearcoatSpecularDirect += ccIrradiance * BRDF_GGX_Clearcoat( directLight.direction, geometryViewDir, geometryClearcoatNormal, material );
	#endif
	#ifdef USE_SHEEN
		sheenSpecularDirect += irradiance * BRDF_Sheen( directLight.direction, geometryViewDir, geometryNormal, material.sheenColor, material.sheenRoughness );
	#endif
	reflectedLight.directSpecular += irradiance * BRDF_GGX( directLight.direction, geometryViewDir, geometryNormal, material );
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Physical( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectSpecular_Physical( const in vec3 radiance, const in vec3 irradiance, const in vec3 clearcoatRadiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight) {
	#ifdef USE_CLEARCOAT
		clearcoatSpecularIndirect += clearcoatRadiance * EnvironmentBRDF( geometryClearcoatNormal, geometryViewDir, material.clearcoatF0, material.clearcoatF90, material.clearcoatRoughness );
	#endif
	#ifdef USE_SHEEN
		sheenSpecularIndirect += irradiance * material.sheenColor * IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
	#endif
	vec3 singleScattering = vec3( 0.0 );
	vec3 multiScattering = vec3( 0.0 );
	vec3 cosineWeightedIrradiance = irradiance * RECIPROCAL_PI;
	#ifdef USE_IRIDESCENCE
		computeMultiscatteringIridescence( geometryNormal, geometryViewDir, material.specularColor, material.specularF90, material.iridescence, material.iridescenceFresnel, material.roughness, singleScattering, multiScattering );
	#else
		computeMultiscattering( geometryNormal, geometryViewDir, material.specularColor, material.specularF90, material.roughness, singleScattering, multiScattering );
	#endif
	vec3 totalScattering = singleScattering + multiScattering;
	vec3 diffuse = material.diffuseColor * ( 1.0 - max( max( totalScattering.r, totalScattering.g ), totalScattering.b ) );
	reflectedLight.indirectSpecular += radiance * singleScattering;
	reflectedLight.indirectSpecular += multiScattering * cosineWeightedIrradiance;
	reflectedLight.indirectDiffuse += diffuse * cosineWeightedIrradiance;
}
#define RE_Direct				RE_Direct_Physical
#define RE_Direct_RectArea		RE_Direct_RectArea_Physical
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Physical
#define RE_IndirectSpecular		RE_IndirectSpecular_Physical
float computeSpecularOcclusion( const in float dotNV, const in float ambientOcclusion, const in float roughness ) {
	return saturate( pow( dotNV + ambientOcclusion, exp2( - 16.0 * roughness - 1.0 ) ) - 1.0 + ambientOcclusion );
}`,Xy=`
vec3 geometryPosition = - vViewPosition;
vec3 geometryNormal = normal;
vec3 geometryViewDir = ( isOrthographic ) ? vec3( 0, 0, 1 ) : normalize( vViewPosition );
vec3 geometryClearcoatNormal = vec3( 0.0 );
#ifdef USE_CLEARCOAT
	geometryClearcoatNormal = clearcoatNormal;
#endif
#ifdef USE_IRIDESCENCE
	float dotNVi = saturate( dot( normal, geometryViewDir ) );
	if ( material.iridescenceThickness == 0.0 ) {
		material.iridescence = 0.0;
	} else {
		material.iridescence = saturate( material.iridescence );
	}
	if ( material.iridescence > 0.0 ) {
		material.iridescenceFresnel = evalIridescence( 1.0, material.iridescenceIOR, dotNVi, material.iridescenceThickness, material.specularColor );
		material.iridescenceF0 = Schlick_to_F0( material.iridescenceFresnel, 1.0, dotNVi );
	}
#endif
IncidentLight directLight;
#if ( NUM_POINT_LIGHTS > 0 ) && defined( RE_Direct )
	PointLight pointLight;
	#if defined( USE_SHADOWMAP ) && NUM_POINT_LIGHT_SHADOWS > 0
	PointLightShadow pointLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHTS; i ++ ) {
		pointLight = pointLights[ i ];
		getPointLightInfo( pointLight, geometryPosition, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_POINT_LIGHT_SHADOWS )
		pointLightShadow = pointLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getPointShadow( pointShadowMap[ i ], pointLightShadow.shadowMapSize, pointLightShadow.shadowIntensity, pointLightShadow.shadowBias, pointLightShadow.shadowRadius, vPointShadowCoord[ i ], pointLightShadow.shadowCameraNear, pointLightShadow.shadowCameraFar ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_SPOT_LIGHTS > 0 ) && defined( RE_Direct )
	SpotLight spotLight;
	vec4 spotColor;
	vec3 spotLightCoord;
	bool inSpotLightMap;
	#if defined( USE_SHADOWMAP ) && NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHTS; i ++ ) {
		spotLight = spotLights[ i ];
		getSpotLightInfo( spotLight, geometryPosition, directLight );
		#if ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#define SPOT_LIGHT_MAP_INDEX UNROLLED_LOOP_INDEX
		#elif ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		#define SPOT_LIGHT_MAP_INDEX NUM_SPOT_LIGHT_MAPS
		#else
		#define SPOT_LIGHT_MAP_INDEX ( UNROLLED_LOOP_INDEX - NUM_SPOT_LIGHT_SHADOWS + NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#endif
		#if ( SPOT_LIGHT_MAP_INDEX < NUM_SPOT_LIGHT_MAPS )
			spotLightCoord = vSpotLightCoord[ i ].xyz / vSpotLightCoord[ i ].w;
			inSpotLightMap = all( lessThan( abs( spotLightCoord * 2. - 1. ), vec3( 1.0 ) ) );
			spotColor = texture2D( spotLightMap[ SPOT_LIGHT_MAP_INDEX ], spotLightCoord.xy );
			directLight.color = inSpotLightMap ? directLight.color * spotColor.rgb : directLight.color;
		#endif
		#undef SPOT_LIGHT_MAP_INDEX
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		spotLightShadow = spotLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( spotShadowMap[ i ], spotLightShadow.shadowMapSize, spotLightShadow.shadowIntensity, spotLightShadow.shadowBias, spotLightShadow.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_DIR_LIGHTS > 0 ) && defined( RE_Direct )
	DirectionalLight directionalLight;
	#if defined( USE_SHADOWMAP ) && NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHTS; i ++ ) {
		directionalLight = directionalLights[ i ];
		getDirectionalLightInfo( directionalLight, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_DIR_LIGHT_SHADOWS )
		directionalLightShadow = directionalLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( directionalShadowMap[ i ], directionalLightShadow.shadowMapSize, directionalLightShadow.shadowIntensity, directionalLightShadow.shadowBias, directionalLightShadow.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_RECT_AREA_LIGHTS > 0 ) && defined( RE_Direct_RectArea )
	RectAreaLight rectAreaLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_RECT_AREA_LIGHTS; i ++ ) {
		rectAreaLight = rectAreaLights[ i ];
		RE_Direct_RectArea( rectAreaLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if defined( RE_IndirectDiffuse )
	vec3 iblIrradiance = vec3( 0.0 );
	vec3 irradiance = getAmbientLightIrradiance( ambientLightColor );
	#if defined( USE_LIGHT_PROBES )
		irradiance += getLightProbeIrradiance( lightProbe, geometryNormal );
	#endif
	#if ( NUM_HEMI_LIGHTS > 0 )
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_HEMI_LIGHTS; i ++ ) {
			irradiance += getHemisphereLightIrradiance( hemisphereLights[ i ], geometryNormal );
		}
		#pragma unroll_loop_end
	#endif
#endif
#if defined( RE_IndirectSpecular )
	vec3 radiance = vec3( 0.0 );
	vec3 clearcoatRadiance = vec3( 0.0 );
#endif`,qy=`#if defined( RE_IndirectDiffuse )
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		vec3 lightMapIrradiance = lightMapTexel.rgb * lightMapIntensity;
		irradiance += lightMapIrradiance;
	#endif
	#if defined( USE_ENVMAP ) && defined( STANDARD ) && defined( ENVMAP_TYPE_CUBE_UV )
		iblIrradiance += getIBLIrradiance( geometryNormal );
	#endif
#endif
#if defined( USE_ENVMAP ) && defined( RE_IndirectSpecular )
	#ifdef USE_ANISOTROPY
		radiance += getIBLAnisotropyRadiance( geometryViewDir, geometryNormal, material.roughness, material.anisotropyB, material.anisotropy );
	#else
		radiance += getIBLRadiance( geometryViewDir, geometryNormal, material.roughness );
	#endif
	#ifdef USE_CLEARCOAT
		clearcoatRadiance += getIBLRadiance( geometryViewDir, geometryClearcoatNormal, material.clearcoatRoughness );
	#endif
#endif`,Yy=`#if defined( RE_IndirectDiffuse )
	RE_IndirectDiffuse( irradiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif
#if defined( RE_IndirectSpecular )
	RE_IndirectSpecular( radiance, iblIrradiance, clearcoatRadiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif`,$y=`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	gl_FragDepth = vIsPerspective == 0.0 ? gl_FragCoord.z : log2( vFragDepth ) * logDepthBufFC * 0.5;
#endif`,Zy=`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	uniform float logDepthBufFC;
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,Jy=`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,Ky=`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	vFragDepth = 1.0 + gl_Position.w;
	vIsPerspective = float( isPerspectiveMatrix( projectionMatrix ) );
#endif`,jy=`#ifdef USE_MAP
	vec4 sampledDiffuseColor = texture2D( map, vMapUv );
	#ifdef DECODE_VIDEO_TEXTURE
		sampledDiffuseColor = sRGBTransferEOTF( sampledDiffuseColor );
	#endif
	diffuseColor *= sampledDiffuseColor;
#endif`,Qy=`#ifdef USE_MAP
	uniform sampler2D map;
#endif`,tv=`#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
	#if defined( USE_POINTS_UV )
		vec2 uv = vUv;
	#else
		vec2 uv = ( uvTransform * vec3( gl_PointCoord.x, 1.0 - gl_PointCoord.y, 1 ) ).xy;
	#endif
#endif
#ifdef USE_MAP
	diffuseColor *= texture2D( map, uv );
#endif
#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, uv ).g;
#endif`,ev=`#if defined( USE_POINTS_UV )
	varying vec2 vUv;
#else
	#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
		uniform mat3 uvTransform;
	#endif
#endif
#ifdef USE_MAP
	uniform sampler2D map;
#endif
#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,nv=`float metalnessFactor = metalness;
#ifdef USE_METALNESSMAP
	vec4 texelMetalness = texture2D( metalnessMap, vMetalnessMapUv );
	metalnessFactor *= texelMetalness.b;
#endif`,iv=`#ifdef USE_METALNESSMAP
	uniform sampler2D metalnessMap;
#endif`,sv=`#ifdef USE_INSTANCING_MORPH
	float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	float morphTargetBaseInfluence = texelFetch( morphTexture, ivec2( 0, gl_InstanceID ), 0 ).r;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		morphTargetInfluences[i] =  texelFetch( morphTexture, ivec2( i + 1, gl_InstanceID ), 0 ).r;
	}
#endif`,rv=`#if defined( USE_MORPHCOLORS )
	vColor *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		#if defined( USE_COLOR_ALPHA )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor += getMorph( gl_VertexID, i, 2 ) * morphTargetInfluences[ i ];
		#elif defined( USE_COLOR )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor += getMorph( gl_VertexID, i, 2 ).rgb * morphTargetInfluences[ i ];
		#endif
	}
#endif`,ov=`#ifdef USE_MORPHNORMALS
	objectNormal *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) objectNormal += getMorph( gl_VertexID, i, 1 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,av=`#ifdef USE_MORPHTARGETS
	#ifndef USE_INSTANCING_MORPH
		uniform float morphTargetBaseInfluence;
		uniform float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	#endif
	uniform sampler2DArray morphTargetsTexture;
	uniform ivec2 morphTargetsTextureSize;
	vec4 getMorph( const in int vertexIndex, const in int morphTargetIndex, const in int offset ) {
		int texelIndex = vertexIndex * MORPHTARGETS_TEXTURE_STRIDE + offset;
		int y = texelIndex / morphTargetsTextureSize.x;
		int x = texelIndex - y * morphTargetsTextureSize.x;
		ivec3 morphUV = ivec3( x, y, morphTargetIndex );
		return texelFetch( morphTargetsTexture, morphUV, 0 );
	}
#endif`,lv=`#ifdef USE_MORPHTARGETS
	transformed *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) transformed += getMorph( gl_VertexID, i, 0 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,cv=`float faceDirection = gl_FrontFacing ? 1.0 : - 1.0;
#ifdef FLAT_SHADED
	vec3 fdx = dFdx( vViewPosition );
	vec3 fdy = dFdy( vViewPosition );
	vec3 normal = normalize( cross( fdx, fdy ) );
#else
	vec3 normal = normalize( vNormal );
	#ifdef DOUBLE_SIDED
		normal *= faceDirection;
	#endif
#endif
#if defined( USE_NORMALMAP_TANGENTSPACE ) || defined( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY )
	#ifdef USE_TANGENT
		mat3 tbn = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn = getTangentFrame( - vViewPosition, normal,
		#if defined( USE_NORMALMAP )
			vNormalMapUv
		#elif defined( USE_CLEARCOAT_NORMALMAP )
			vClearcoatNormalMapUv
		#else
			vUv
		#endif
		);
	#endif
	#if defined( DOUBLE_SIDED ) && ! defined( FLAT_SHADED )
		tbn[0] *= faceDirection;
		tbn[1] *= faceDirection;
	#endif
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	#ifdef USE_TANGENT
		mat3 tbn2 = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn2 = getTangentFrame( - vViewPosition, normal, vClearcoatNormalMapUv );
	#endif
	#if defined( DOUBLE_SIDED ) && ! defined( FLAT_SHADED )
		tbn2[0] *= faceDirection;
		tbn2[1] *= faceDirection;
	#endif
#endif
vec3 nonPerturbedNormal = normal;`,hv=`#ifdef USE_NORMALMAP_OBJECTSPACE
	normal = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	#ifdef FLIP_SIDED
		normal = - normal;
	#endif
	#ifdef DOUBLE_SIDED
		normal = normal * faceDirection;
	#endif
	normal = normalize( normalMatrix * normal );
#elif defined( USE_NORMALMAP_TANGENTSPACE )
	vec3 mapN = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	mapN.xy *= normalScale;
	normal = normalize( tbn * mapN );
#elif defined( USE_BUMPMAP )
	normal = perturbNormalArb( - vViewPosition, normal, dHdxy_fwd(), faceDirection );
#endif`,uv=`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,dv=`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,fv=`#ifndef FLAT_SHADED
	vNormal = normalize( transformedNormal );
	#ifdef USE_TANGENT
		vTangent = normalize( transformedTangent );
		vBitangent = normalize( cross( vNormal, vTangent ) * tangent.w );
	#endif
#endif`,pv=`#ifdef USE_NORMALMAP
	uniform sampler2D normalMap;
	uniform vec2 normalScale;
#endif
#ifdef USE_NORMALMAP_OBJECTSPACE
	uniform mat3 normalMatrix;
#endif
#if ! defined ( USE_TANGENT ) && ( defined ( USE_NORMALMAP_TANGENTSPACE ) || defined ( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY ) )
	mat3 getTangentFrame( vec3 eye_pos, vec3 surf_norm, vec2 uv ) {
		vec3 q0 = dFdx( eye_pos.xyz );
		vec3 q1 = dFdy( eye_pos.xyz );
		vec2 st0 = dFdx( uv.st );
		vec2 st1 = dFdy( uv.st );
		vec3 N = surf_norm;
		vec3 q1perp = cross( q1, N );
		vec3 q0perp = cross( N, q0 );
		vec3 T = q1perp * st0.x + q0perp * st1.x;
		vec3 B = q1perp * st0.y + q0perp * st1.y;
		float det = max( dot( T, T ), dot( B, B ) );
		float scale = ( det == 0.0 ) ? 0.0 : inversesqrt( det );
		return mat3( T * scale, B * scale, N );
	}
#endif`,mv=`#ifdef USE_CLEARCOAT
	vec3 clearcoatNormal = nonPerturbedNormal;
#endif`,gv=`#ifdef USE_CLEARCOAT_NORMALMAP
	vec3 clearcoatMapN = texture2D( clearcoatNormalMap, vClearcoatNormalMapUv ).xyz * 2.0 - 1.0;
	clearcoatMapN.xy *= clearcoatNormalScale;
	clearcoatNormal = normalize( tbn2 * clearcoatMapN );
#endif`,_v=`#ifdef USE_CLEARCOATMAP
	uniform sampler2D clearcoatMap;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform sampler2D clearcoatNormalMap;
	uniform vec2 clearcoatNormalScale;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform sampler2D clearcoatRoughnessMap;
#endif`,xv=`#ifdef USE_IRIDESCENCEMAP
	uniform sampler2D iridescenceMap;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform sampler2D iridescenceThicknessMap;
#endif`,yv=`#ifdef OPAQUE
diffuseColor.a = 1.0;
#endif
#ifdef USE_TRANSMISSION
diffuseColor.a *= material.transmissionAlpha;
#endif
gl_FragColor = vec4( outgoingLight, diffuseColor.a );`,vv=`vec3 packNormalToRGB( const in vec3 normal ) {
	return normalize( normal ) * 0.5 + 0.5;
}
vec3 unpackRGBToNormal( const in vec3 rgb ) {
	return 2.0 * rgb.xyz - 1.0;
}
const float PackUpscale = 256. / 255.;const float UnpackDownscale = 255. / 256.;const float ShiftRight8 = 1. / 256.;
const float Inv255 = 1. / 255.;
const vec4 PackFactors = vec4( 1.0, 256.0, 256.0 * 256.0, 256.0 * 256.0 * 256.0 );
const vec2 UnpackFactors2 = vec2( UnpackDownscale, 1.0 / PackFactors.g );
const vec3 UnpackFactors3 = vec3( UnpackDownscale / PackFactors.rg, 1.0 / PackFactors.b );
const vec4 UnpackFactors4 = vec4( UnpackDownscale / PackFactors.rgb, 1.0 / PackFactors.a );
vec4 packDepthToRGBA( const in float v ) {
	if( v <= 0.0 )
		return vec4( 0., 0., 0., 0. );
	if( v >= 1.0 )
		return vec4( 1., 1., 1., 1. );
	float vuf;
	float af = modf( v * PackFactors.a, vuf );
	float bf = modf( vuf * ShiftRight8, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec4( vuf * Inv255, gf * PackUpscale, bf * PackUpscale, af );
}
vec3 packDepthToRGB( const in float v ) {
	if( v <= 0.0 )
		return vec3( 0., 0., 0. );
	if( v >= 1.0 )
		return vec3( 1., 1., 1. );
	float vuf;
	float bf = modf( v * PackFactors.b, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec3( vuf * Inv255, gf * PackUpscale, bf );
}
vec2 packDepthToRG( const in float v ) {
	if( v <= 0.0 )
		return vec2( 0., 0. );
	if( v >= 1.0 )
		return vec2( 1., 1. );
	float vuf;
	float gf = modf( v * 256., vuf );
	return vec2( vuf * Inv255, gf );
}
float unpackRGBAToDepth( const in vec4 v ) {
	return dot( v, UnpackFactors4 );
}
float unpackRGBToDepth( const in vec3 v ) {
	return dot( v, UnpackFactors3 );
}
float unpackRGToDepth( const in vec2 v ) {
	return v.r * UnpackFactors2.r + v.g * UnpackFactors2.g;
}
vec4 pack2HalfToRGBA( const in vec2 v ) {
	vec4 r = vec4( v.x, fract( v.x * 255.0 ), v.y, fract( v.y * 255.0 ) );
	return vec4( r.x - r.y / 255.0, r.y, r.z - r.w / 255.0, r.w );
}
vec2 unpackRGBATo2Half( const in vec4 v ) {
	return vec2( v.x + ( v.y / 255.0 ), v.z + ( v.w / 255.0 ) );
}
float viewZToOrthographicDepth( const in float viewZ, const in float near, const in float far ) {
	return ( viewZ + near ) / ( near - far );
}
float orthographicDepthToViewZ( const in float depth, const in float near, const in float far ) {
	return depth * ( near - far ) - near;
}
float viewZToPerspectiveDepth( const in float viewZ, const in float near, const in float far ) {
	return ( ( near + viewZ ) * far ) / ( ( far - near ) * viewZ );
}
float perspectiveDepthToViewZ( const in float depth, const in float near, const in float far ) {
	return ( near * far ) / ( ( far - near ) * depth - far );
}`,Mv=`#ifdef PREMULTIPLIED_ALPHA
	gl_FragColor.rgb *= gl_FragColor.a;
#endif`,bv=`vec4 mvPosition = vec4( transformed, 1.0 );
#ifdef USE_BATCHING
	mvPosition = batchingMatrix * mvPosition;
#endif
#ifdef USE_INSTANCING
	mvPosition = instanceMatrix * mvPosition;
#endif
mvPosition = modelViewMatrix * mvPosition;
gl_Position = projectionMatrix * mvPosition;`,Sv=`#ifdef DITHERING
	gl_FragColor.rgb = dithering( gl_FragColor.rgb );
#endif`,wv=`#ifdef DITHERING
	vec3 dithering( vec3 color ) {
		float grid_position = rand( gl_FragCoord.xy );
		vec3 dither_shift_RGB = vec3( 0.25 / 255.0, -0.25 / 255.0, 0.25 / 255.0 );
		dither_shift_RGB = mix( 2.0 * dither_shift_RGB, -2.0 * dither_shift_RGB, grid_position );
		return color + dither_shift_RGB;
	}
#endif`,Ev=`float roughnessFactor = roughness;
#ifdef USE_ROUGHNESSMAP
	vec4 texelRoughness = texture2D( roughnessMap, vRoughnessMapUv );
	roughnessFactor *= texelRoughness.g;
#endif`,Tv=`#ifdef USE_ROUGHNESSMAP
	uniform sampler2D roughnessMap;
#endif`,Av=`#if NUM_SPOT_LIGHT_COORDS > 0
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#if NUM_SPOT_LIGHT_MAPS > 0
	uniform sampler2D spotLightMap[ NUM_SPOT_LIGHT_MAPS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
		uniform sampler2D directionalShadowMap[ NUM_DIR_LIGHT_SHADOWS ];
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		uniform sampler2D spotShadowMap[ NUM_SPOT_LIGHT_SHADOWS ];
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		uniform sampler2D pointShadowMap[ NUM_POINT_LIGHT_SHADOWS ];
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
	float texture2DCompare( sampler2D depths, vec2 uv, float compare ) {
		float depth = unpackRGBAToDepth( texture2D( depths, uv ) );
		#ifdef USE_REVERSED_DEPTH_BUFFER
			return step( depth, compare );
		#else
			return step( compare, depth );
		#endif
	}
	vec2 texture2DDistribution( sampler2D shadow, vec2 uv ) {
		return unpackRGBATo2Half( texture2D( shadow, uv ) );
	}
	float VSMShadow( sampler2D shadow, vec2 uv, float compare ) {
		float occlusion = 1.0;
		vec2 distribution = texture2DDistribution( shadow, uv );
		#ifdef USE_REVERSED_DEPTH_BUFFER
			float hard_shadow = step( distribution.x, compare );
		#else
			float hard_shadow = step( compare, distribution.x );
		#endif
		if ( hard_shadow != 1.0 ) {
			float distance = compare - distribution.x;
			float variance = max( 0.00000, distribution.y * distribution.y );
			float softness_probability = variance / (variance + distance * distance );			softness_probability = clamp( ( softness_probability - 0.3 ) / ( 0.95 - 0.3 ), 0.0, 1.0 );			occlusion = clamp( max( hard_shadow, softness_probability ), 0.0, 1.0 );
		}
		return occlusion;
	}
	float getShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
		float shadow = 1.0;
		shadowCoord.xyz /= shadowCoord.w;
		shadowCoord.z += shadowBias;
		bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
		bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
		if ( frustumTest ) {
		#if defined( SHADOWMAP_TYPE_PCF )
			vec2 texelSize = vec2( 1.0 ) / shadowMapSize;
			float dx0 = - texelSize.x * shadowRadius;
			float dy0 = - texelSize.y * shadowRadius;
			float dx1 = + texelSize.x * shadowRadius;
			float dy1 = + texelSize.y * shadowRadius;
			float dx2 = dx0 / 2.0;
			float dy2 = dy0 / 2.0;
			float dx3 = dx1 / 2.0;
			float dy3 = dy1 / 2.0;
			shadow = (
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx0, dy0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( 0.0, dy0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx1, dy0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx2, dy2 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( 0.0, dy2 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx3, dy2 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx0, 0.0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx2, 0.0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy, shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx3, 0.0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx1, 0.0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx2, dy3 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( 0.0, dy3 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx3, dy3 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx0, dy1 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( 0.0, dy1 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, shadowCoord.xy + vec2( dx1, dy1 ), shadowCoord.z )
			) * ( 1.0 / 17.0 );
		#elif defined( SHADOWMAP_TYPE_PCF_SOFT )
			vec2 texelSize = vec2( 1.0 ) / shadowMapSize;
			float dx = texelSize.x;
			float dy = texelSize.y;
			vec2 uv = shadowCoord.xy;
			vec2 f = fract( uv * shadowMapSize + 0.5 );
			uv -= f * texelSize;
			shadow = (
				texture2DCompare( shadowMap, uv, shadowCoord.z ) +
				texture2DCompare( shadowMap, uv + vec2( dx, 0.0 ), shadowCoord.z ) +
				texture2DCompare( shadowMap, uv + vec2( 0.0, dy ), shadowCoord.z ) +
				texture2DCompare( shadowMap, uv + texelSize, shadowCoord.z ) +
				mix( texture2DCompare( shadowMap, uv + vec2( -dx, 0.0 ), shadowCoord.z ),
					 texture2DCompare( shadowMap, uv + vec2( 2.0 * dx, 0.0 ), shadowCoord.z ),
					 f.x ) +
				mix( texture2DCompare( shadowMap, uv + vec2( -dx, dy ), shadowCoord.z ),
					 texture2DCompare( shadowMap, uv + vec2( 2.0 * dx, dy ), shadowCoord.z ),
					 f.x ) +
				mix( texture2DCompare( shadowMap, uv + vec2( 0.0, -dy ), shadowCoord.z ),
					 texture2DCompare( shadowMap, uv + vec2( 0.0, 2.0 * dy ), shadowCoord.z ),
					 f.y ) +
				mix( texture2DCompare( shadowMap, uv + vec2( dx, -dy ), shadowCoord.z ),
					 texture2DCompare( shadowMap, uv + vec2( dx, 2.0 * dy ), shadowCoord.z ),
					 f.y ) +
				mix( mix( texture2DCompare( shadowMap, uv + vec2( -dx, -dy ), shadowCoord.z ),
						  texture2DCompare( shadowMap, uv + vec2( 2.0 * dx, -dy ), shadowCoord.z ),
						  f.x ),
					 mix( texture2DCompare( shadowMap, uv + vec2( -dx, 2.0 * dy ), shadowCoord.z ),
						  texture2DCompare( shadowMap, uv + vec2( 2.0 * dx, 2.0 * dy ), shadowCoord.z ),
						  f.x ),
					 f.y )
			) * ( 1.0 / 9.0 );
		#elif defined( SHADOWMAP_TYPE_VSM )
			shadow = VSMShadow( shadowMap, shadowCoord.xy, shadowCoord.z );
		#else
			shadow = texture2DCompare( shadowMap, shadowCoord.xy, shadowCoord.z );
		#endif
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
	vec2 cubeToUV( vec3 v, float texelSizeY ) {
		vec3 absV = abs( v );
		float scaleToCube = 1.0 / max( absV.x, max( absV.y, absV.z ) );
		absV *= scaleToCube;
		v *= scaleToCube * ( 1.0 - 2.0 * texelSizeY );
		vec2 planar = v.xy;
		float almostATexel = 1.5 * texelSizeY;
		float almostOne = 1.0 - almostATexel;
		if ( absV.z >= almostOne ) {
			if ( v.z > 0.0 )
				planar.x = 4.0 - v.x;
		} else if ( absV.x >= almostOne ) {
			float signX = sign( v.x );
			planar.x = v.z * signX + 2.0 * signX;
		} else if ( absV.y >= almostOne ) {
			float signY = sign( v.y );
			planar.x = v.x + 2.0 * signY + 2.0;
			planar.y = v.z * signY - 2.0;
		}
		return vec2( 0.125, 0.25 ) * planar + vec2( 0.375, 0.75 );
	}
	float getPointShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord, float shadowCameraNear, float shadowCameraFar ) {
		float shadow = 1.0;
		vec3 lightToPosition = shadowCoord.xyz;
		
		float lightToPositionLength = length( lightToPosition );
		if ( lightToPositionLength - shadowCameraFar <= 0.0 && lightToPositionLength - shadowCameraNear >= 0.0 ) {
			float dp = ( lightToPositionLength - shadowCameraNear ) / ( shadowCameraFar - shadowCameraNear );			dp += shadowBias;
			vec3 bd3D = normalize( lightToPosition );
			vec2 texelSize = vec2( 1.0 ) / ( shadowMapSize * vec2( 4.0, 2.0 ) );
			#if defined( SHADOWMAP_TYPE_PCF ) || defined( SHADOWMAP_TYPE_PCF_SOFT ) || defined( SHADOWMAP_TYPE_VSM )
				vec2 offset = vec2( - 1, 1 ) * shadowRadius * texelSize.y;
				shadow = (
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.xyy, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.yyy, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.xyx, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.yyx, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.xxy, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.yxy, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.xxx, texelSize.y ), dp ) +
					texture2DCompare( shadowMap, cubeToUV( bd3D + offset.yxx, texelSize.y ), dp )
				) * ( 1.0 / 9.0 );
			#else
				shadow = texture2DCompare( shadowMap, cubeToUV( bd3D, texelSize.y ), dp );
			#endif
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
#endif`,Rv=`#if NUM_SPOT_LIGHT_COORDS > 0
	uniform mat4 spotLightMatrix[ NUM_SPOT_LIGHT_COORDS ];
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
		uniform mat4 directionalShadowMatrix[ NUM_DIR_LIGHT_SHADOWS ];
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		uniform mat4 pointShadowMatrix[ NUM_POINT_LIGHT_SHADOWS ];
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
#endif`,Cv=`#if ( defined( USE_SHADOWMAP ) && ( NUM_DIR_LIGHT_SHADOWS > 0 || NUM_POINT_LIGHT_SHADOWS > 0 ) ) || ( NUM_SPOT_LIGHT_COORDS > 0 )
	vec3 shadowWorldNormal = inverseTransformDirection( transformedNormal, viewMatrix );
	vec4 shadowWorldPosition;
#endif
#if defined( USE_SHADOWMAP )
	#if NUM_DIR_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * directionalLightShadows[ i ].shadowNormalBias, 0 );
			vDirectionalShadowCoord[ i ] = directionalShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * pointLightShadows[ i ].shadowNormalBias, 0 );
			vPointShadowCoord[ i ] = pointShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
#endif
#if NUM_SPOT_LIGHT_COORDS > 0
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_COORDS; i ++ ) {
		shadowWorldPosition = worldPosition;
		#if ( defined( USE_SHADOWMAP ) && UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
			shadowWorldPosition.xyz += shadowWorldNormal * spotLightShadows[ i ].shadowNormalBias;
		#endif
		vSpotLightCoord[ i ] = spotLightMatrix[ i ] * shadowWorldPosition;
	}
	#pragma unroll_loop_end
#endif`,Pv=`float getShadowMask() {
	float shadow = 1.0;
	#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
		directionalLight = directionalLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( directionalShadowMap[ i ], directionalLight.shadowMapSize, directionalLight.shadowIntensity, directionalLight.shadowBias, directionalLight.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_SHADOWS; i ++ ) {
		spotLight = spotLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( spotShadowMap[ i ], spotLight.shadowMapSize, spotLight.shadowIntensity, spotLight.shadowBias, spotLight.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
	PointLightShadow pointLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
		pointLight = pointLightShadows[ i ];
		shadow *= receiveShadow ? getPointShadow( pointShadowMap[ i ], pointLight.shadowMapSize, pointLight.shadowIntensity, pointLight.shadowBias, pointLight.shadowRadius, vPointShadowCoord[ i ], pointLight.shadowCameraNear, pointLight.shadowCameraFar ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#endif
	return shadow;
}`,Iv=`#ifdef USE_SKINNING
	mat4 boneMatX = getBoneMatrix( skinIndex.x );
	mat4 boneMatY = getBoneMatrix( skinIndex.y );
	mat4 boneMatZ = getBoneMatrix( skinIndex.z );
	mat4 boneMatW = getBoneMatrix( skinIndex.w );
#endif`,Lv=`#ifdef USE_SKINNING
	uniform mat4 bindMatrix;
	uniform mat4 bindMatrixInverse;
	uniform highp sampler2D boneTexture;
	mat4 getBoneMatrix( const in float i ) {
		int size = textureSize( boneTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( boneTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( boneTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( boneTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( boneTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
#endif`,Dv=`#ifdef USE_SKINNING
	vec4 skinVertex = bindMatrix * vec4( transformed, 1.0 );
	vec4 skinned = vec4( 0.0 );
	skinned += boneMatX * skinVertex * skinWeight.x;
	skinned += boneMatY * skinVertex * skinWeight.y;
	skinned += boneMatZ * skinVertex * skinWeight.z;
	skinned += boneMatW * skinVertex * skinWeight.w;
	transformed = ( bindMatrixInverse * skinned ).xyz;
#endif`,Nv=`#ifdef USE_SKINNING
	mat4 skinMatrix = mat4( 0.0 );
	skinMatrix += skinWeight.x * boneMatX;
	skinMatrix += skinWeight.y * boneMatY;
	skinMatrix += skinWeight.z * boneMatZ;
	skinMatrix += skinWeight.w * boneMatW;
	skinMatrix = bindMatrixInverse * skinMatrix * bindMatrix;
	objectNormal = vec4( skinMatrix * vec4( objectNormal, 0.0 ) ).xyz;
	#ifdef USE_TANGENT
		objectTangent = vec4( skinMatrix * vec4( objectTangent, 0.0 ) ).xyz;
	#endif
#endif`,Uv=`float specularStrength;
#ifdef USE_SPECULARMAP
	vec4 texelSpecular = texture2D( specularMap, vSpecularMapUv );
	specularStrength = texelSpecular.r;
#else
	specularStrength = 1.0;
#endif`,Fv=`#ifdef USE_SPECULARMAP
	uniform sampler2D specularMap;
#endif`,Ov=`#if defined( TONE_MAPPING )
	gl_FragColor.rgb = toneMapping( gl_FragColor.rgb );
#endif`,Bv=`#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
uniform float toneMappingExposure;
vec3 LinearToneMapping( vec3 color ) {
	return saturate( toneMappingExposure * color );
}
vec3 ReinhardToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	return saturate( color / ( vec3( 1.0 ) + color ) );
}
vec3 CineonToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	color = max( vec3( 0.0 ), color - 0.004 );
	return pow( ( color * ( 6.2 * color + 0.5 ) ) / ( color * ( 6.2 * color + 1.7 ) + 0.06 ), vec3( 2.2 ) );
}
vec3 RRTAndODTFit( vec3 v ) {
	vec3 a = v * ( v + 0.0245786 ) - 0.000090537;
	vec3 b = v * ( 0.983729 * v + 0.4329510 ) + 0.238081;
	return a / b;
}
vec3 ACESFilmicToneMapping( vec3 color ) {
	const mat3 ACESInputMat = mat3(
		vec3( 0.59719, 0.07600, 0.02840 ),		vec3( 0.35458, 0.90834, 0.13383 ),
		vec3( 0.04823, 0.01566, 0.83777 )
	);
	const mat3 ACESOutputMat = mat3(
		vec3(  1.60475, -0.10208, -0.00327 ),		vec3( -0.53108,  1.10813, -0.07276 ),
		vec3( -0.07367, -0.00605,  1.07602 )
	);
	color *= toneMappingExposure / 0.6;
	color = ACESInputMat * color;
	color = RRTAndODTFit( color );
	color = ACESOutputMat * color;
	return saturate( color );
}
const mat3 LINEAR_REC2020_TO_LINEAR_SRGB = mat3(
	vec3( 1.6605, - 0.1246, - 0.0182 ),
	vec3( - 0.5876, 1.1329, - 0.1006 ),
	vec3( - 0.0728, - 0.0083, 1.1187 )
);
const mat3 LINEAR_SRGB_TO_LINEAR_REC2020 = mat3(
	vec3( 0.6274, 0.0691, 0.0164 ),
	vec3( 0.3293, 0.9195, 0.0880 ),
	vec3( 0.0433, 0.0113, 0.8956 )
);
vec3 agxDefaultContrastApprox( vec3 x ) {
	vec3 x2 = x * x;
	vec3 x4 = x2 * x2;
	return + 15.5 * x4 * x2
		- 40.14 * x4 * x
		+ 31.96 * x4
		- 6.868 * x2 * x
		+ 0.4298 * x2
		+ 0.1191 * x
		- 0.00232;
}
vec3 AgXToneMapping( vec3 color ) {
	const mat3 AgXInsetMatrix = mat3(
		vec3( 0.856627153315983, 0.137318972929847, 0.11189821299995 ),
		vec3( 0.0951212405381588, 0.761241990602591, 0.0767994186031903 ),
		vec3( 0.0482516061458583, 0.101439036467562, 0.811302368396859 )
	);
	const mat3 AgXOutsetMatrix = mat3(
		vec3( 1.1271005818144368, - 0.1413297634984383, - 0.14132976349843826 ),
		vec3( - 0.11060664309660323, 1.157823702216272, - 0.11060664309660294 ),
		vec3( - 0.016493938717834573, - 0.016493938717834257, 1.2519364065950405 )
	);
	const float AgxMinEv = - 12.47393;	const float AgxMaxEv = 4.026069;
	color *= toneMappingExposure;
	color = LINEAR_SRGB_TO_LINEAR_REC2020 * color;
	color = AgXInsetMatrix * color;
	color = max( color, 1e-10 );	color = log2( color );
	color = ( color - AgxMinEv ) / ( AgxMaxEv - AgxMinEv );
	color = clamp( color, 0.0, 1.0 );
	color = agxDefaultContrastApprox( color );
	color = AgXOutsetMatrix * color;
	color = pow( max( vec3( 0.0 ), color ), vec3( 2.2 ) );
	color = LINEAR_REC2020_TO_LINEAR_SRGB * color;
	color = clamp( color, 0.0, 1.0 );
	return color;
}
vec3 NeutralToneMapping( vec3 color ) {
	const float StartCompression = 0.8 - 0.04;
	const float Desaturation = 0.15;
	color *= toneMappingExposure;
	float x = min( color.r, min( color.g, color.b ) );
	float offset = x < 0.08 ? x - 6.25 * x * x : 0.04;
	color -= offset;
	float peak = max( color.r, max( color.g, color.b ) );
	if ( peak < StartCompression ) return color;
	float d = 1. - StartCompression;
	float newPeak = 1. - d * d / ( peak + d - StartCompression );
	color *= newPeak / peak;
	float g = 1. - 1. / ( Desaturation * ( peak - newPeak ) + 1. );
	return mix( color, vec3( newPeak ), g );
}
vec3 CustomToneMapping( vec3 color ) { return color; }`,kv=`#ifdef USE_TRANSMISSION
	material.transmission = transmission;
	material.transmissionAlpha = 1.0;
	material.thickness = thickness;
	material.attenuationDistance = attenuationDistance;
	material.attenuationColor = attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		material.transmission *= texture2D( transmissionMap, vTransmissionMapUv ).r;
	#endif
	#ifdef USE_THICKNESSMAP
		material.thickness *= texture2D( thicknessMap, vThicknessMapUv ).g;
	#endif
	vec3 pos = vWorldPosition;
	vec3 v = normalize( cameraPosition - pos );
	vec3 n = inverseTransformDirection( normal, viewMatrix );
	vec4 transmitted = getIBLVolumeRefraction(
		n, v, material.roughness, material.diffuseColor, material.specularColor, material.specularF90,
		pos, modelMatrix, viewMatrix, projectionMatrix, material.dispersion, material.ior, material.thickness,
		material.attenuationColor, material.attenuationDistance );
	material.transmissionAlpha = mix( material.transmissionAlpha, transmitted.a, material.transmission );
	totalDiffuse = mix( totalDiffuse, transmitted.rgb, material.transmission );
#endif`,zv=`#ifdef USE_TRANSMISSION
	uniform float transmission;
	uniform float thickness;
	uniform float attenuationDistance;
	uniform vec3 attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		uniform sampler2D transmissionMap;
	#endif
	#ifdef USE_THICKNESSMAP
		uniform sampler2D thicknessMap;
	#endif
	uniform vec2 transmissionSamplerSize;
	uniform sampler2D transmissionSamplerMap;
	uniform mat4 modelMatrix;
	uniform mat4 projectionMatrix;
	varying vec3 vWorldPosition;
	float w0( float a ) {
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - a + 3.0 ) - 3.0 ) + 1.0 );
	}
	float w1( float a ) {
		return ( 1.0 / 6.0 ) * ( a *  a * ( 3.0 * a - 6.0 ) + 4.0 );
	}
	float w2( float a ){
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - 3.0 * a + 3.0 ) + 3.0 ) + 1.0 );
	}
	float w3( float a ) {
		return ( 1.0 / 6.0 ) * ( a * a * a );
	}
	float g0( float a ) {
		return w0( a ) + w1( a );
	}
	float g1( float a ) {
		return w2( a ) + w3( a );
	}
	float h0( float a ) {
		return - 1.0 + w1( a ) / ( w0( a ) + w1( a ) );
	}
	float h1( float a ) {
		return 1.0 + w3( a ) / ( w2( a ) + w3( a ) );
	}
	vec4 bicubic( sampler2D tex, vec2 uv, vec4 texelSize, float lod ) {
		uv = uv * texelSize.zw + 0.5;
		vec2 iuv = floor( uv );
		vec2 fuv = fract( uv );
		float g0x = g0( fuv.x );
		float g1x = g1( fuv.x );
		float h0x = h0( fuv.x );
		float h1x = h1( fuv.x );
		float h0y = h0( fuv.y );
		float h1y = h1( fuv.y );
		vec2 p0 = ( vec2( iuv.x + h0x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p1 = ( vec2( iuv.x + h1x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p2 = ( vec2( iuv.x + h0x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		vec2 p3 = ( vec2( iuv.x + h1x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		return g0( fuv.y ) * ( g0x * textureLod( tex, p0, lod ) + g1x * textureLod( tex, p1, lod ) ) +
			g1( fuv.y ) * ( g0x * textureLod( tex, p2, lod ) + g1x * textureLod( tex, p3, lod ) );
	}
	vec4 textureBicubic( sampler2D sampler, vec2 uv, float lod ) {
		vec2 fLodSize = vec2( textureSize( sampler, int( lod ) ) );
		vec2 cLodSize = vec2( textureSize( sampler, int( lod + 1.0 ) ) );
		vec2 fLodSizeInv = 1.0 / fLodSize;
		vec2 cLodSizeInv = 1.0 / cLodSize;
		vec4 fSample = bicubic( sampler, uv, vec4( fLodSizeInv, fLodSize ), floor( lod ) );
		vec4 cSample = bicubic( sampler, uv, vec4( cLodSizeInv, cLodSize ), ceil( lod ) );
		return mix( fSample, cSample, fract( lod ) );
	}
	vec3 getVolumeTransmissionRay( const in vec3 n, const in vec3 v, const in float thickness, const in float ior, const in mat4 modelMatrix ) {
		vec3 refractionVector = refract( - v, normalize( n ), 1.0 / ior );
		vec3 modelScale;
		modelScale.x = length( vec3( modelMatrix[ 0 ].xyz ) );
		modelScale.y = length( vec3( modelMatrix[ 1 ].xyz ) );
		modelScale.z = length( vec3( modelMatrix[ 2 ].xyz ) );
		return normalize( refractionVector ) * thickness * modelScale;
	}
	float applyIorToRoughness( const in float roughness, const in float ior ) {
		return roughness * clamp( ior * 2.0 - 2.0, 0.0, 1.0 );
	}
	vec4 getTransmissionSample( const in vec2 fragCoord, const in float roughness, const in float ior ) {
		float lod = log2( transmissionSamplerSize.x ) * applyIorToRoughness( roughness, ior );
		return textureBicubic( transmissionSamplerMap, fragCoord.xy, lod );
	}
	vec3 volumeAttenuation( const in float transmissionDistance, const in vec3 attenuationColor, const in float attenuationDistance ) {
		if ( isinf( attenuationDistance ) ) {
			return vec3( 1.0 );
		} else {
			vec3 attenuationCoefficient = -log( attenuationColor ) / attenuationDistance;
			vec3 transmittance = exp( - attenuationCoefficient * transmissionDistance );			return transmittance;
		}
	}
	vec4 getIBLVolumeRefraction( const in vec3 n, const in vec3 v, const in float roughness, const in vec3 diffuseColor,
		const in vec3 specularColor, const in float specularF90, const in vec3 position, const in mat4 modelMatrix,
		const in mat4 viewMatrix, const in mat4 projMatrix, const in float dispersion, const in float ior, const in float thickness,
		const in vec3 attenuationColor, const in float attenuationDistance ) {
		vec4 transmittedLight;
		vec3 transmittance;
		#ifdef USE_DISPERSION
			float halfSpread = ( ior - 1.0 ) * 0.025 * dispersion;
			vec3 iors = vec3( ior - halfSpread, ior, ior + halfSpread );
			for ( int i = 0; i < 3; i ++ ) {
				vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, iors[ i ], modelMatrix );
				vec3 refractedRayExit = position + transmissionRay;
				vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
				vec2 refractionCoords = ndcPos.xy / ndcPos.w;
				refractionCoords += 1.0;
				refractionCoords /= 2.0;
				vec4 transmissionSample = getTransmissionSample( refractionCoords, roughness, iors[ i ] );
				transmittedLight[ i ] = transmissionSample[ i ];
				transmittedLight.a += transmissionSample.a;
				transmittance[ i ] = diffuseColor[ i ] * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance )[ i ];
			}
			transmittedLight.a /= 3.0;
		#else
			vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, ior, modelMatrix );
			vec3 refractedRayExit = position + transmissionRay;
			vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
			vec2 refractionCoords = ndcPos.xy / ndcPos.w;
			refractionCoords += 1.0;
			refractionCoords /= 2.0;
			transmittedLight = getTransmissionSample( refractionCoords, roughness, ior );
			transmittance = diffuseColor * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance );
		#endif
		vec3 attenuatedColor = transmittance * transmittedLight.rgb;
		vec3 F = EnvironmentBRDF( n, v, specularColor, specularF90, roughness );
		float transmittanceFactor = ( transmittance.r + transmittance.g + transmittance.b ) / 3.0;
		return vec4( ( 1.0 - F ) * attenuatedColor, 1.0 - ( 1.0 - transmittedLight.a ) * transmittanceFactor );
	}
#endif`,Vv=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_SPECULARMAP
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,Hv=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	uniform mat3 mapTransform;
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	uniform mat3 alphaMapTransform;
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	uniform mat3 lightMapTransform;
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	uniform mat3 aoMapTransform;
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	uniform mat3 bumpMapTransform;
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	uniform mat3 normalMapTransform;
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_DISPLACEMENTMAP
	uniform mat3 displacementMapTransform;
	varying vec2 vDisplacementMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	uniform mat3 emissiveMapTransform;
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	uniform mat3 metalnessMapTransform;
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	uniform mat3 roughnessMapTransform;
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	uniform mat3 anisotropyMapTransform;
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	uniform mat3 clearcoatMapTransform;
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform mat3 clearcoatNormalMapTransform;
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform mat3 clearcoatRoughnessMapTransform;
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	uniform mat3 sheenColorMapTransform;
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	uniform mat3 sheenRoughnessMapTransform;
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	uniform mat3 iridescenceMapTransform;
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform mat3 iridescenceThicknessMapTransform;
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SPECULARMAP
	uniform mat3 specularMapTransform;
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	uniform mat3 specularColorMapTransform;
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	uniform mat3 specularIntensityMapTransform;
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,Gv=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	vUv = vec3( uv, 1 ).xy;
#endif
#ifdef USE_MAP
	vMapUv = ( mapTransform * vec3( MAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ALPHAMAP
	vAlphaMapUv = ( alphaMapTransform * vec3( ALPHAMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_LIGHTMAP
	vLightMapUv = ( lightMapTransform * vec3( LIGHTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_AOMAP
	vAoMapUv = ( aoMapTransform * vec3( AOMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_BUMPMAP
	vBumpMapUv = ( bumpMapTransform * vec3( BUMPMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_NORMALMAP
	vNormalMapUv = ( normalMapTransform * vec3( NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_DISPLACEMENTMAP
	vDisplacementMapUv = ( displacementMapTransform * vec3( DISPLACEMENTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_EMISSIVEMAP
	vEmissiveMapUv = ( emissiveMapTransform * vec3( EMISSIVEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_METALNESSMAP
	vMetalnessMapUv = ( metalnessMapTransform * vec3( METALNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ROUGHNESSMAP
	vRoughnessMapUv = ( roughnessMapTransform * vec3( ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ANISOTROPYMAP
	vAnisotropyMapUv = ( anisotropyMapTransform * vec3( ANISOTROPYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOATMAP
	vClearcoatMapUv = ( clearcoatMapTransform * vec3( CLEARCOATMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	vClearcoatNormalMapUv = ( clearcoatNormalMapTransform * vec3( CLEARCOAT_NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	vClearcoatRoughnessMapUv = ( clearcoatRoughnessMapTransform * vec3( CLEARCOAT_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCEMAP
	vIridescenceMapUv = ( iridescenceMapTransform * vec3( IRIDESCENCEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	vIridescenceThicknessMapUv = ( iridescenceThicknessMapTransform * vec3( IRIDESCENCE_THICKNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_COLORMAP
	vSheenColorMapUv = ( sheenColorMapTransform * vec3( SHEEN_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	vSheenRoughnessMapUv = ( sheenRoughnessMapTransform * vec3( SHEEN_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULARMAP
	vSpecularMapUv = ( specularMapTransform * vec3( SPECULARMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_COLORMAP
	vSpecularColorMapUv = ( specularColorMapTransform * vec3( SPECULAR_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	vSpecularIntensityMapUv = ( specularIntensityMapTransform * vec3( SPECULAR_INTENSITYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_TRANSMISSIONMAP
	vTransmissionMapUv = ( transmissionMapTransform * vec3( TRANSMISSIONMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_THICKNESSMAP
	vThicknessMapUv = ( thicknessMapTransform * vec3( THICKNESSMAP_UV, 1 ) ).xy;
#endif`,Wv=`#if defined( USE_ENVMAP ) || defined( DISTANCE ) || defined ( USE_SHADOWMAP ) || defined ( USE_TRANSMISSION ) || NUM_SPOT_LIGHT_COORDS > 0
	vec4 worldPosition = vec4( transformed, 1.0 );
	#ifdef USE_BATCHING
		worldPosition = batchingMatrix * worldPosition;
	#endif
	#ifdef USE_INSTANCING
		worldPosition = instanceMatrix * worldPosition;
	#endif
	worldPosition = modelMatrix * worldPosition;
#endif`,Xv=`varying vec2 vUv;
uniform mat3 uvTransform;
void main() {
	vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	gl_Position = vec4( position.xy, 1.0, 1.0 );
}`,qv=`uniform sampler2D t2D;
uniform float backgroundIntensity;
varying vec2 vUv;
void main() {
	vec4 texColor = texture2D( t2D, vUv );
	#ifdef DECODE_VIDEO_TEXTURE
		texColor = vec4( mix( pow( texColor.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), texColor.rgb * 0.0773993808, vec3( lessThanEqual( texColor.rgb, vec3( 0.04045 ) ) ) ), texColor.w );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,Yv=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,$v=`#ifdef ENVMAP_TYPE_CUBE
	uniform samplerCube envMap;
#elif defined( ENVMAP_TYPE_CUBE_UV )
	uniform sampler2D envMap;
#endif
uniform float flipEnvMap;
uniform float backgroundBlurriness;
uniform float backgroundIntensity;
uniform mat3 backgroundRotation;
varying vec3 vWorldDirection;
#include <cube_uv_reflection_fragment>
void main() {
	#ifdef ENVMAP_TYPE_CUBE
		vec4 texColor = textureCube( envMap, backgroundRotation * vec3( flipEnvMap * vWorldDirection.x, vWorldDirection.yz ) );
	#elif defined( ENVMAP_TYPE_CUBE_UV )
		vec4 texColor = textureCubeUV( envMap, backgroundRotation * vWorldDirection, backgroundBlurriness );
	#else
		vec4 texColor = vec4( 0.0, 0.0, 0.0, 1.0 );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,Zv=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,Jv=`uniform samplerCube tCube;
uniform float tFlip;
uniform float opacity;
varying vec3 vWorldDirection;
void main() {
	vec4 texColor = textureCube( tCube, vec3( tFlip * vWorldDirection.x, vWorldDirection.yz ) );
	gl_FragColor = texColor;
	gl_FragColor.a *= opacity;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,Kv=`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
varying vec2 vHighPrecisionZW;
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vHighPrecisionZW = gl_Position.zw;
}`,jv=`#if DEPTH_PACKING == 3200
	uniform float opacity;
#endif
#include <common>
#include <packing>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
varying vec2 vHighPrecisionZW;
void main() {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#if DEPTH_PACKING == 3200
		diffuseColor.a = opacity;
	#endif
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <logdepthbuf_fragment>
	#ifdef USE_REVERSED_DEPTH_BUFFER
		float fragCoordZ = vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ];
	#else
		float fragCoordZ = 0.5 * vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ] + 0.5;
	#endif
	#if DEPTH_PACKING == 3200
		gl_FragColor = vec4( vec3( 1.0 - fragCoordZ ), opacity );
	#elif DEPTH_PACKING == 3201
		gl_FragColor = packDepthToRGBA( fragCoordZ );
	#elif DEPTH_PACKING == 3202
		gl_FragColor = vec4( packDepthToRGB( fragCoordZ ), 1.0 );
	#elif DEPTH_PACKING == 3203
		gl_FragColor = vec4( packDepthToRG( fragCoordZ ), 0.0, 1.0 );
	#endif
}`,Qv=`#define DISTANCE
varying vec3 vWorldPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <worldpos_vertex>
	#include <clipping_planes_vertex>
	vWorldPosition = worldPosition.xyz;
}`,tM=`#define DISTANCE
uniform vec3 referencePosition;
uniform float nearDistance;
uniform float farDistance;
varying vec3 vWorldPosition;
#include <common>
#include <packing>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <clipping_planes_pars_fragment>
void main () {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	float dist = length( vWorldPosition - referencePosition );
	dist = ( dist - nearDistance ) / ( farDistance - nearDistance );
	dist = saturate( dist );
	gl_FragColor = packDepthToRGBA( dist );
}`,eM=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
}`,nM=`uniform sampler2D tEquirect;
varying vec3 vWorldDirection;
#include <common>
void main() {
	vec3 direction = normalize( vWorldDirection );
	vec2 sampleUV = equirectUv( direction );
	gl_FragColor = texture2D( tEquirect, sampleUV );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,iM=`uniform float scale;
attribute float lineDistance;
varying float vLineDistance;
#include <common>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	vLineDistance = scale * lineDistance;
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,sM=`uniform vec3 diffuse;
uniform float opacity;
uniform float dashSize;
uniform float totalSize;
varying float vLineDistance;
#include <common>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	if ( mod( vLineDistance, totalSize ) > dashSize ) {
		discard;
	}
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,rM=`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#if defined ( USE_ENVMAP ) || defined ( USE_SKINNING )
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinbase_vertex>
		#include <skinnormal_vertex>
		#include <defaultnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <fog_vertex>
}`,oM=`uniform vec3 diffuse;
uniform float opacity;
#ifndef FLAT_SHADED
	varying vec3 vNormal;
#endif
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <fog_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		reflectedLight.indirectDiffuse += lightMapTexel.rgb * lightMapIntensity * RECIPROCAL_PI;
	#else
		reflectedLight.indirectDiffuse += vec3( 1.0 );
	#endif
	#include <aomap_fragment>
	reflectedLight.indirectDiffuse *= diffuseColor.rgb;
	vec3 outgoingLight = reflectedLight.indirectDiffuse;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,aM=`#define LAMBERT
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,lM=`#define LAMBERT
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <packing>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_lambert_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_lambert_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,cM=`#define MATCAP
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <displacementmap_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
	vViewPosition = - mvPosition.xyz;
}`,hM=`#define MATCAP
uniform vec3 diffuse;
uniform float opacity;
uniform sampler2D matcap;
varying vec3 vViewPosition;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	vec3 viewDir = normalize( vViewPosition );
	vec3 x = normalize( vec3( viewDir.z, 0.0, - viewDir.x ) );
	vec3 y = cross( viewDir, x );
	vec2 uv = vec2( dot( x, normal ), dot( y, normal ) ) * 0.495 + 0.5;
	#ifdef USE_MATCAP
		vec4 matcapColor = texture2D( matcap, uv );
	#else
		vec4 matcapColor = vec4( vec3( mix( 0.2, 0.8, uv.y ) ), 1.0 );
	#endif
	vec3 outgoingLight = diffuseColor.rgb * matcapColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,uM=`#define NORMAL
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	vViewPosition = - mvPosition.xyz;
#endif
}`,dM=`#define NORMAL
uniform float opacity;
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <packing>
#include <uv_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( 0.0, 0.0, 0.0, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	gl_FragColor = vec4( packNormalToRGB( normal ), diffuseColor.a );
	#ifdef OPAQUE
		gl_FragColor.a = 1.0;
	#endif
}`,fM=`#define PHONG
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,pM=`#define PHONG
uniform vec3 diffuse;
uniform vec3 emissive;
uniform vec3 specular;
uniform float shininess;
uniform float opacity;
#include <common>
#include <packing>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_phong_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_phong_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + reflectedLight.directSpecular + reflectedLight.indirectSpecular + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,mM=`#define STANDARD
varying vec3 vViewPosition;
#ifdef USE_TRANSMISSION
	varying vec3 vWorldPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
#ifdef USE_TRANSMISSION
	vWorldPosition = worldPosition.xyz;
#endif
}`,gM=`#define STANDARD
#ifdef PHYSICAL
	#define IOR
	#define USE_SPECULAR
#endif
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float roughness;
uniform float metalness;
uniform float opacity;
#ifdef IOR
	uniform float ior;
#endif
#ifdef USE_SPECULAR
	uniform float specularIntensity;
	uniform vec3 specularColor;
	#ifdef USE_SPECULAR_COLORMAP
		uniform sampler2D specularColorMap;
	#endif
	#ifdef USE_SPECULAR_INTENSITYMAP
		uniform sampler2D specularIntensityMap;
	#endif
#endif
#ifdef USE_CLEARCOAT
	uniform float clearcoat;
	uniform float clearcoatRoughness;
#endif
#ifdef USE_DISPERSION
	uniform float dispersion;
#endif
#ifdef USE_IRIDESCENCE
	uniform float iridescence;
	uniform float iridescenceIOR;
	uniform float iridescenceThicknessMinimum;
	uniform float iridescenceThicknessMaximum;
#endif
#ifdef USE_SHEEN
	uniform vec3 sheenColor;
	uniform float sheenRoughness;
	#ifdef USE_SHEEN_COLORMAP
		uniform sampler2D sheenColorMap;
	#endif
	#ifdef USE_SHEEN_ROUGHNESSMAP
		uniform sampler2D sheenRoughnessMap;
	#endif
#endif
#ifdef USE_ANISOTROPY
	uniform vec2 anisotropyVector;
	#ifdef USE_ANISOTROPYMAP
		uniform sampler2D anisotropyMap;
	#endif
#endif
varying vec3 vViewPosition;
#include <common>
#include <packing>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <iridescence_fragment>
#include <cube_uv_reflection_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_physical_pars_fragment>
#include <transmission_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <clearcoat_pars_fragment>
#include <iridescence_pars_fragment>
#include <roughnessmap_pars_fragment>
#include <metalnessmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <roughnessmap_fragment>
	#include <metalnessmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <clearcoat_normal_fragment_begin>
	#include <clearcoat_normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_physical_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 totalDiffuse = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse;
	vec3 totalSpecular = reflectedLight.directSpecular + reflectedLight.indirectSpecular;
	#include <transmission_fragment>
	vec3 outgoingLight = totalDiffuse + totalSpecular + totalEmissiveRadiance;
	#ifdef USE_SHEEN
		float sheenEnergyComp = 1.0 - 0.157 * max3( material.sheenColor );
		outgoingLight = outgoingLight * sheenEnergyComp + sheenSpecularDirect + sheenSpecularIndirect;
	#endif
	#ifdef USE_CLEARCOAT
		float dotNVcc = saturate( dot( geometryClearcoatNormal, geometryViewDir ) );
		vec3 Fcc = F_Schlick( material.clearcoatF0, material.clearcoatF90, dotNVcc );
		outgoingLight = outgoingLight * ( 1.0 - material.clearcoat * Fcc ) + ( clearcoatSpecularDirect + clearcoatSpecularIndirect ) * material.clearcoat;
	#endif
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,_M=`#define TOON
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,xM=`#define TOON
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <packing>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <gradientmap_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_toon_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_toon_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,yM=`uniform float size;
uniform float scale;
#include <common>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
#ifdef USE_POINTS_UV
	varying vec2 vUv;
	uniform mat3 uvTransform;
#endif
void main() {
	#ifdef USE_POINTS_UV
		vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	#endif
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	gl_PointSize = size;
	#ifdef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) gl_PointSize *= ( scale / - mvPosition.z );
	#endif
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <fog_vertex>
}`,vM=`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <color_pars_fragment>
#include <map_particle_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_particle_fragment>
	#include <color_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,MM=`#include <common>
#include <batching_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <shadowmap_pars_vertex>
void main() {
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,bM=`uniform vec3 color;
uniform float opacity;
#include <common>
#include <packing>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <logdepthbuf_pars_fragment>
#include <shadowmap_pars_fragment>
#include <shadowmask_pars_fragment>
void main() {
	#include <logdepthbuf_fragment>
	gl_FragColor = vec4( color, opacity * ( 1.0 - getShadowMask() ) );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
}`,SM=`uniform float rotation;
uniform vec2 center;
#include <common>
#include <uv_pars_vertex>
#include <fog_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	vec4 mvPosition = modelViewMatrix[ 3 ];
	vec2 scale = vec2( length( modelMatrix[ 0 ].xyz ), length( modelMatrix[ 1 ].xyz ) );
	#ifndef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) scale *= - mvPosition.z;
	#endif
	vec2 alignedPosition = ( position.xy - ( center - vec2( 0.5 ) ) ) * scale;
	vec2 rotatedPosition;
	rotatedPosition.x = cos( rotation ) * alignedPosition.x - sin( rotation ) * alignedPosition.y;
	rotatedPosition.y = sin( rotation ) * alignedPosition.x + cos( rotation ) * alignedPosition.y;
	mvPosition.xy += rotatedPosition;
	gl_Position = projectionMatrix * mvPosition;
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,wM=`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
}`,ae={alphahash_fragment:qx,alphahash_pars_fragment:Yx,alphamap_fragment:$x,alphamap_pars_fragment:Zx,alphatest_fragment:Jx,alphatest_pars_fragment:Kx,aomap_fragment:jx,aomap_pars_fragment:Qx,batching_pars_vertex:ty,batching_vertex:ey,begin_vertex:ny,beginnormal_vertex:iy,bsdfs:sy,iridescence_fragment:ry,bumpmap_pars_fragment:oy,clipping_planes_fragment:ay,clipping_planes_pars_fragment:ly,clipping_planes_pars_vertex:cy,clipping_planes_vertex:hy,color_fragment:uy,color_pars_fragment:dy,color_pars_vertex:fy,color_vertex:py,common:my,cube_uv_reflection_fragment:gy,defaultnormal_vertex:_y,displacementmap_pars_vertex:xy,displacementmap_vertex:yy,emissivemap_fragment:vy,emissivemap_pars_fragment:My,colorspace_fragment:by,colorspace_pars_fragment:Sy,envmap_fragment:wy,envmap_common_pars_fragment:Ey,envmap_pars_fragment:Ty,envmap_pars_vertex:Ay,envmap_physical_pars_fragment:By,envmap_vertex:Ry,fog_vertex:Cy,fog_pars_vertex:Py,fog_fragment:Iy,fog_pars_fragment:Ly,gradientmap_pars_fragment:Dy,lightmap_pars_fragment:Ny,lights_lambert_fragment:Uy,lights_lambert_pars_fragment:Fy,lights_pars_begin:Oy,lights_toon_fragment:ky,lights_toon_pars_fragment:zy,lights_phong_fragment:Vy,lights_phong_pars_fragment:Hy,lights_physical_fragment:Gy,lights_physical_pars_fragment:Wy,lights_fragment_begin:Xy,lights_fragment_maps:qy,lights_fragment_end:Yy,logdepthbuf_fragment:$y,logdepthbuf_pars_fragment:Zy,logdepthbuf_pars_vertex:Jy,logdepthbuf_vertex:Ky,map_fragment:jy,map_pars_fragment:Qy,map_particle_fragment:tv,map_particle_pars_fragment:ev,metalnessmap_fragment:nv,metalnessmap_pars_fragment:iv,morphinstance_vertex:sv,morphcolor_vertex:rv,morphnormal_vertex:ov,morphtarget_pars_vertex:av,morphtarget_vertex:lv,normal_fragment_begin:cv,normal_fragment_maps:hv,normal_pars_fragment:uv,normal_pars_vertex:dv,normal_vertex:fv,normalmap_pars_fragment:pv,clearcoat_normal_fragment_begin:mv,clearcoat_normal_fragment_maps:gv,clearcoat_pars_fragment:_v,iridescence_pars_fragment:xv,opaque_fragment:yv,packing:vv,premultiplied_alpha_fragment:Mv,project_vertex:bv,dithering_fragment:Sv,dithering_pars_fragment:wv,roughnessmap_fragment:Ev,roughnessmap_pars_fragment:Tv,shadowmap_pars_fragment:Av,shadowmap_pars_vertex:Rv,shadowmap_vertex:Cv,shadowmask_pars_fragment:Pv,skinbase_vertex:Iv,skinning_pars_vertex:Lv,skinning_vertex:Dv,skinnormal_vertex:Nv,specularmap_fragment:Uv,specularmap_pars_fragment:Fv,tonemapping_fragment:Ov,tonemapping_pars_fragment:Bv,transmission_fragment:kv,transmission_pars_fragment:zv,uv_pars_fragment:Vv,uv_pars_vertex:Hv,uv_vertex:Gv,worldpos_vertex:Wv,background_vert:Xv,background_frag:qv,backgroundCube_vert:Yv,backgroundCube_frag:$v,cube_vert:Zv,cube_frag:Jv,depth_vert:Kv,depth_frag:jv,distanceRGBA_vert:Qv,distanceRGBA_frag:tM,equirect_vert:eM,equirect_frag:nM,linedashed_vert:iM,linedashed_frag:sM,meshbasic_vert:rM,meshbasic_frag:oM,meshlambert_vert:aM,meshlambert_frag:lM,meshmatcap_vert:cM,meshmatcap_frag:hM,meshnormal_vert:uM,meshnormal_frag:dM,meshphong_vert:fM,meshphong_frag:pM,meshphysical_vert:mM,meshphysical_frag:gM,meshtoon_vert:_M,meshtoon_frag:xM,points_vert:yM,points_frag:vM,shadow_vert:MM,shadow_frag:bM,sprite_vert:SM,sprite_frag:wM},St={common:{diffuse:{value:new jt(16777215)},opacity:{value:1},map:{value:null},mapTransform:{value:new re},alphaMap:{value:null},alphaMapTransform:{value:new re},alphaTest:{value:0}},specularmap:{specularMap:{value:null},specularMapTransform:{value:new re}},envmap:{envMap:{value:null},envMapRotation:{value:new re},flipEnvMap:{value:-1},reflectivity:{value:1},ior:{value:1.5},refractionRatio:{value:.98}},aomap:{aoMap:{value:null},aoMapIntensity:{value:1},aoMapTransform:{value:new re}},lightmap:{lightMap:{value:null},lightMapIntensity:{value:1},lightMapTransform:{value:new re}},bumpmap:{bumpMap:{value:null},bumpMapTransform:{value:new re},bumpScale:{value:1}},normalmap:{normalMap:{value:null},normalMapTransform:{value:new re},normalScale:{value:new Jt(1,1)}},displacementmap:{displacementMap:{value:null},displacementMapTransform:{value:new re},displacementScale:{value:1},displacementBias:{value:0}},emissivemap:{emissiveMap:{value:null},emissiveMapTransform:{value:new re}},metalnessmap:{metalnessMap:{value:null},metalnessMapTransform:{value:new re}},roughnessmap:{roughnessMap:{value:null},roughnessMapTransform:{value:new re}},gradientmap:{gradientMap:{value:null}},fog:{fogDensity:{value:25e-5},fogNear:{value:1},fogFar:{value:2e3},fogColor:{value:new jt(16777215)}},lights:{ambientLightColor:{value:[]},lightProbe:{value:[]},directionalLights:{value:[],properties:{direction:{},color:{}}},directionalLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},directionalShadowMap:{value:[]},directionalShadowMatrix:{value:[]},spotLights:{value:[],properties:{color:{},position:{},direction:{},distance:{},coneCos:{},penumbraCos:{},decay:{}}},spotLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},spotLightMap:{value:[]},spotShadowMap:{value:[]},spotLightMatrix:{value:[]},pointLights:{value:[],properties:{color:{},position:{},decay:{},distance:{}}},pointLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{},shadowCameraNear:{},shadowCameraFar:{}}},pointShadowMap:{value:[]},pointShadowMatrix:{value:[]},hemisphereLights:{value:[],properties:{direction:{},skyColor:{},groundColor:{}}},rectAreaLights:{value:[],properties:{color:{},position:{},width:{},height:{}}},ltc_1:{value:null},ltc_2:{value:null}},points:{diffuse:{value:new jt(16777215)},opacity:{value:1},size:{value:1},scale:{value:1},map:{value:null},alphaMap:{value:null},alphaMapTransform:{value:new re},alphaTest:{value:0},uvTransform:{value:new re}},sprite:{diffuse:{value:new jt(16777215)},opacity:{value:1},center:{value:new Jt(.5,.5)},rotation:{value:0},map:{value:null},mapTransform:{value:new re},alphaMap:{value:null},alphaMapTransform:{value:new re},alphaTest:{value:0}}},Ui={basic:{uniforms:En([St.common,St.specularmap,St.envmap,St.aomap,St.lightmap,St.fog]),vertexShader:ae.meshbasic_vert,fragmentShader:ae.meshbasic_frag},lambert:{uniforms:En([St.common,St.specularmap,St.envmap,St.aomap,St.lightmap,St.emissivemap,St.bumpmap,St.normalmap,St.displacementmap,St.fog,St.lights,{emissive:{value:new jt(0)}}]),vertexShader:ae.meshlambert_vert,fragmentShader:ae.meshlambert_frag},phong:{uniforms:En([St.common,St.specularmap,St.envmap,St.aomap,St.lightmap,St.emissivemap,St.bumpmap,St.normalmap,St.displacementmap,St.fog,St.lights,{emissive:{value:new jt(0)},specular:{value:new jt(1118481)},shininess:{value:30}}]),vertexShader:ae.meshphong_vert,fragmentShader:ae.meshphong_frag},standard:{uniforms:En([St.common,St.envmap,St.aomap,St.lightmap,St.emissivemap,St.bumpmap,St.normalmap,St.displacementmap,St.roughnessmap,St.metalnessmap,St.fog,St.lights,{emissive:{value:new jt(0)},roughness:{value:1},metalness:{value:0},envMapIntensity:{value:1}}]),vertexShader:ae.meshphysical_vert,fragmentShader:ae.meshphysical_frag},toon:{uniforms:En([St.common,St.aomap,St.lightmap,St.emissivemap,St.bumpmap,St.normalmap,St.displacementmap,St.gradientmap,St.fog,St.lights,{emissive:{value:new jt(0)}}]),vertexShader:ae.meshtoon_vert,fragmentShader:ae.meshtoon_frag},matcap:{uniforms:En([St.common,St.bumpmap,St.normalmap,St.displacementmap,St.fog,{matcap:{value:null}}]),vertexShader:ae.meshmatcap_vert,fragmentShader:ae.meshmatcap_frag},points:{uniforms:En([St.points,St.fog]),vertexShader:ae.points_vert,fragmentShader:ae.points_frag},dashed:{uniforms:En([St.common,St.fog,{scale:{value:1},dashSize:{value:1},totalSize:{value:2}}]),vertexShader:ae.linedashed_vert,fragmentShader:ae.linedashed_frag},depth:{uniforms:En([St.common,St.displacementmap]),vertexShader:ae.depth_vert,fragmentShader:ae.depth_frag},normal:{uniforms:En([St.common,St.bumpmap,St.normalmap,St.displacementmap,{opacity:{value:1}}]),vertexShader:ae.meshnormal_vert,fragmentShader:ae.meshnormal_frag},sprite:{uniforms:En([St.sprite,St.fog]),vertexShader:ae.sprite_vert,fragmentShader:ae.sprite_frag},background:{uniforms:{uvTransform:{value:new re},t2D:{value:null},backgroundIntensity:{value:1}},vertexShader:ae.background_vert,fragmentShader:ae.background_frag},backgroundCube:{uniforms:{envMap:{value:null},flipEnvMap:{value:-1},backgroundBlurriness:{value:0},backgroundIntensity:{value:1},backgroundRotation:{value:new re}},vertexShader:ae.backgroundCube_vert,fragmentShader:ae.backgroundCube_frag},cube:{uniforms:{tCube:{value:null},tFlip:{value:-1},opacity:{value:1}},vertexShader:ae.cube_vert,fragmentShader:ae.cube_frag},equirect:{uniforms:{tEquirect:{value:null}},vertexShader:ae.equirect_vert,fragmentShader:ae.equirect_frag},distanceRGBA:{uniforms:En([St.common,St.displacementmap,{referencePosition:{value:new H},nearDistance:{value:1},farDistance:{value:1e3}}]),vertexShader:ae.distanceRGBA_vert,fragmentShader:ae.distanceRGBA_frag},shadow:{uniforms:En([St.lights,St.fog,{color:{value:new jt(0)},opacity:{value:1}}]),vertexShader:ae.shadow_vert,fragmentShader:ae.shadow_frag}};Ui.physical={uniforms:En([Ui.standard.uniforms,{clearcoat:{value:0},clearcoatMap:{value:null},clearcoatMapTransform:{value:new re},clearcoatNormalMap:{value:null},clearcoatNormalMapTransform:{value:new re},clearcoatNormalScale:{value:new Jt(1,1)},clearcoatRoughness:{value:0},clearcoatRoughnessMap:{value:null},clearcoatRoughnessMapTransform:{value:new re},dispersion:{value:0},iridescence:{value:0},iridescenceMap:{value:null},iridescenceMapTransform:{value:new re},iridescenceIOR:{value:1.3},iridescenceThicknessMinimum:{value:100},iridescenceThicknessMaximum:{value:400},iridescenceThicknessMap:{value:null},iridescenceThicknessMapTransform:{value:new re},sheen:{value:0},sheenColor:{value:new jt(0)},sheenColorMap:{value:null},sheenColorMapTransform:{value:new re},sheenRoughness:{value:1},sheenRoughnessMap:{value:null},sheenRoughnessMapTransform:{value:new re},transmission:{value:0},transmissionMap:{value:null},transmissionMapTransform:{value:new re},transmissionSamplerSize:{value:new Jt},transmissionSamplerMap:{value:null},thickness:{value:0},thicknessMap:{value:null},thicknessMapTransform:{value:new re},attenuationDistance:{value:0},attenuationColor:{value:new jt(0)},specularColor:{value:new jt(1,1,1)},specularColorMap:{value:null},specularColorMapTransform:{value:new re},specularIntensity:{value:1},specularIntensityMap:{value:null},specularIntensityMapTransform:{value:new re},anisotropyVector:{value:new Jt},anisotropyMap:{value:null},anisotropyMapTransform:{value:new re}}]),vertexShader:ae.meshphysical_vert,fragmentShader:ae.meshphysical_frag};var uc={r:0,b:0,g:0},ir=new Li,EM=new Re;function TM(i,t,e,n,s,r,o){let a=new jt(0),c=r===!0?0:1,l,h,u=null,d=0,f=null;function g(E){let v=E.isScene===!0?E.background:null;return v&&v.isTexture&&(v=(E.backgroundBlurriness>0?e:t).get(v)),v}function x(E){let v=!1,C=g(E);C===null?p(a,c):C&&C.isColor&&(p(C,1),v=!0);let A=i.xr.getEnvironmentBlendMode();A==="additive"?n.buffers.color.setClear(0,0,0,1,o):A==="alpha-blend"&&n.buffers.color.setClear(0,0,0,0,o),(i.autoClear||v)&&(n.buffers.depth.setTest(!0),n.buffers.depth.setMask(!0),n.buffers.color.setMask(!0),i.clear(i.autoClearColor,i.autoClearDepth,i.autoClearStencil))}function m(E,v){let C=g(v);C&&(C.isCubeTexture||C.mapping===Zo)?(h===void 0&&(h=new tn(new ys(1,1,1),new on({name:"BackgroundCubeMaterial",uniforms:nr(Ui.backgroundCube.uniforms),vertexShader:Ui.backgroundCube.vertexShader,fragmentShader:Ui.backgroundCube.fragmentShader,side:Fn,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),h.geometry.deleteAttribute("normal"),h.geometry.deleteAttribute("uv"),h.onBeforeRender=function(A,D,U){this.matrixWorld.copyPosition(U.matrixWorld)},Object.defineProperty(h.material,"envMap",{get:function(){return this.uniforms.envMap.value}}),s.update(h)),ir.copy(v.backgroundRotation),ir.x*=-1,ir.y*=-1,ir.z*=-1,C.isCubeTexture&&C.isRenderTargetTexture===!1&&(ir.y*=-1,ir.z*=-1),h.material.uniforms.envMap.value=C,h.material.uniforms.flipEnvMap.value=C.isCubeTexture&&C.isRenderTargetTexture===!1?-1:1,h.material.uniforms.backgroundBlurriness.value=v.backgroundBlurriness,h.material.uniforms.backgroundIntensity.value=v.backgroundIntensity,h.material.uniforms.backgroundRotation.value.setFromMatrix4(EM.makeRotationFromEuler(ir)),h.material.toneMapped=fe.getTransfer(C.colorSpace)!==Ee,(u!==C||d!==C.version||f!==i.toneMapping)&&(h.material.needsUpdate=!0,u=C,d=C.version,f=i.toneMapping),h.layers.enableAll(),E.unshift(h,h.geometry,h.material,0,0,null)):C&&C.isTexture&&(l===void 0&&(l=new tn(new qo(2,2),new on({name:"BackgroundMaterial",uniforms:nr(Ui.background.uniforms),vertexShader:Ui.background.vertexShader,fragmentShader:Ui.background.fragmentShader,side:Zi,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),l.geometry.deleteAttribute("normal"),Object.defineProperty(l.material,"map",{get:function(){return this.uniforms.t2D.value}}),s.update(l)),l.material.uniforms.t2D.value=C,l.material.uniforms.backgroundIntensity.value=v.backgroundIntensity,l.material.toneMapped=fe.getTransfer(C.colorSpace)!==Ee,C.matrixAutoUpdate===!0&&C.updateMatrix(),l.material.uniforms.uvTransform.value.copy(C.matrix),(u!==C||d!==C.version||f!==i.toneMapping)&&(l.material.needsUpdate=!0,u=C,d=C.version,f=i.toneMapping),l.layers.enableAll(),E.unshift(l,l.geometry,l.material,0,0,null))}function p(E,v){E.getRGB(uc,uu(i)),n.buffers.color.setClear(uc.r,uc.g,uc.b,v,o)}function w(){h!==void 0&&(h.geometry.dispose(),h.material.dispose(),h=void 0),l!==void 0&&(l.geometry.dispose(),l.material.dispose(),l=void 0)}return{getClearColor:function(){return a},setClearColor:function(E,v=1){a.set(E),c=v,p(a,c)},getClearAlpha:function(){return c},setClearAlpha:function(E){c=E,p(a,c)},render:x,addToRenderList:m,dispose:w}}function AM(i,t){let e=i.getParameter(i.MAX_VERTEX_ATTRIBS),n={},s=d(null),r=s,o=!1;function a(b,P,O,z,W){let X=!1,Y=u(z,O,P);r!==Y&&(r=Y,l(r.object)),X=f(b,z,O,W),X&&g(b,z,O,W),W!==null&&t.update(W,i.ELEMENT_ARRAY_BUFFER),(X||o)&&(o=!1,v(b,P,O,z),W!==null&&i.bindBuffer(i.ELEMENT_ARRAY_BUFFER,t.get(W).buffer))}function c(){return i.createVertexArray()}function l(b){return i.bindVertexArray(b)}function h(b){return i.deleteVertexArray(b)}function u(b,P,O){let z=O.wireframe===!0,W=n[b.id];W===void 0&&(W={},n[b.id]=W);let X=W[P.id];X===void 0&&(X={},W[P.id]=X);let Y=X[z];return Y===void 0&&(Y=d(c()),X[z]=Y),Y}function d(b){let P=[],O=[],z=[];for(let W=0;W<e;W++)P[W]=0,O[W]=0,z[W]=0;return{geometry:null,program:null,wireframe:!1,newAttributes:P,enabledAttributes:O,attributeDivisors:z,object:b,attributes:{},index:null}}function f(b,P,O,z){let W=r.attributes,X=P.attributes,Y=0,j=O.getAttributes();for(let K in j)if(j[K].location>=0){let lt=W[K],xt=X[K];if(xt===void 0&&(K==="instanceMatrix"&&b.instanceMatrix&&(xt=b.instanceMatrix),K==="instanceColor"&&b.instanceColor&&(xt=b.instanceColor)),lt===void 0||lt.attribute!==xt||xt&&lt.data!==xt.data)return!0;Y++}return r.attributesNum!==Y||r.index!==z}function g(b,P,O,z){let W={},X=P.attributes,Y=0,j=O.getAttributes();for(let K in j)if(j[K].location>=0){let lt=X[K];lt===void 0&&(K==="instanceMatrix"&&b.instanceMatrix&&(lt=b.instanceMatrix),K==="instanceColor"&&b.instanceColor&&(lt=b.instanceColor));let xt={};xt.attribute=lt,lt&&lt.data&&(xt.data=lt.data),W[K]=xt,Y++}r.attributes=W,r.attributesNum=Y,r.index=z}function x(){let b=r.newAttributes;for(let P=0,O=b.length;P<O;P++)b[P]=0}function m(b){p(b,0)}function p(b,P){let O=r.newAttributes,z=r.enabledAttributes,W=r.attributeDivisors;O[b]=1,z[b]===0&&(i.enableVertexAttribArray(b),z[b]=1),W[b]!==P&&(i.vertexAttribDivisor(b,P),W[b]=P)}function w(){let b=r.newAttributes,P=r.enabledAttributes;for(let O=0,z=P.length;O<z;O++)P[O]!==b[O]&&(i.disableVertexAttribArray(O),P[O]=0)}function E(b,P,O,z,W,X,Y){Y===!0?i.vertexAttribIPointer(b,P,O,W,X):i.vertexAttribPointer(b,P,O,z,W,X)}function v(b,P,O,z){x();let W=z.attributes,X=O.getAttributes(),Y=P.defaultAttributeValues;for(let j in X){let K=X[j];if(K.location>=0){let at=W[j];if(at===void 0&&(j==="instanceMatrix"&&b.instanceMatrix&&(at=b.instanceMatrix),j==="instanceColor"&&b.instanceColor&&(at=b.instanceColor)),at!==void 0){let lt=at.normalized,xt=at.itemSize,Mt=t.get(at);if(Mt===void 0)continue;let _t=Mt.buffer,ie=Mt.type,Qt=Mt.bytesPerElement,Q=ie===i.INT||ie===i.UNSIGNED_INT||at.gpuType===Pl;if(at.isInterleavedBufferAttribute){let et=at.data,wt=et.stride,kt=at.offset;if(et.isInstancedInterleavedBuffer){for(let yt=0;yt<K.locationSize;yt++)p(K.location+yt,et.meshPerAttribute);b.isInstancedMesh!==!0&&z._maxInstanceCount===void 0&&(z._maxInstanceCount=et.meshPerAttribute*et.count)}else for(let yt=0;yt<K.locationSize;yt++)m(K.location+yt);i.bindBuffer(i.ARRAY_BUFFER,_t);for(let yt=0;yt<K.locationSize;yt++)E(K.location+yt,xt/K.locationSize,ie,lt,wt*Qt,(kt+xt/K.locationSize*yt)*Qt,Q)}else{if(at.isInstancedBufferAttribute){for(let et=0;et<K.locationSize;et++)p(K.location+et,at.meshPerAttribute);b.isInstancedMesh!==!0&&z._maxInstanceCount===void 0&&(z._maxInstanceCount=at.meshPerAttribute*at.count)}else for(let et=0;et<K.locationSize;et++)m(K.location+et);i.bindBuffer(i.ARRAY_BUFFER,_t);for(let et=0;et<K.locationSize;et++)E(K.location+et,xt/K.locationSize,ie,lt,xt*Qt,xt/K.locationSize*et*Qt,Q)}}else if(Y!==void 0){let lt=Y[j];if(lt!==void 0)switch(lt.length){case 2:i.vertexAttrib2fv(K.location,lt);break;case 3:i.vertexAttrib3fv(K.location,lt);break;case 4:i.vertexAttrib4fv(K.location,lt);break;default:i.vertexAttrib1fv(K.location,lt)}}}}w()}function C(){U();for(let b in n){let P=n[b];for(let O in P){let z=P[O];for(let W in z)h(z[W].object),delete z[W];delete P[O]}delete n[b]}}function A(b){if(n[b.id]===void 0)return;let P=n[b.id];for(let O in P){let z=P[O];for(let W in z)h(z[W].object),delete z[W];delete P[O]}delete n[b.id]}function D(b){for(let P in n){let O=n[P];if(O[b.id]===void 0)continue;let z=O[b.id];for(let W in z)h(z[W].object),delete z[W];delete O[b.id]}}function U(){S(),o=!0,r!==s&&(r=s,l(r.object))}function S(){s.geometry=null,s.program=null,s.wireframe=!1}return{setup:a,reset:U,resetDefaultState:S,dispose:C,releaseStatesOfGeometry:A,releaseStatesOfProgram:D,initAttributes:x,enableAttribute:m,disableUnusedAttributes:w}}function RM(i,t,e){let n;function s(l){n=l}function r(l,h){i.drawArrays(n,l,h),e.update(h,n,1)}function o(l,h,u){u!==0&&(i.drawArraysInstanced(n,l,h,u),e.update(h,n,u))}function a(l,h,u){if(u===0)return;t.get("WEBGL_multi_draw").multiDrawArraysWEBGL(n,l,0,h,0,u);let f=0;for(let g=0;g<u;g++)f+=h[g];e.update(f,n,1)}function c(l,h,u,d){if(u===0)return;let f=t.get("WEBGL_multi_draw");if(f===null)for(let g=0;g<l.length;g++)o(l[g],h[g],d[g]);else{f.multiDrawArraysInstancedWEBGL(n,l,0,h,0,d,0,u);let g=0;for(let x=0;x<u;x++)g+=h[x]*d[x];e.update(g,n,1)}}this.setMode=s,this.render=r,this.renderInstances=o,this.renderMultiDraw=a,this.renderMultiDrawInstances=c}function CM(i,t,e,n){let s;function r(){if(s!==void 0)return s;if(t.has("EXT_texture_filter_anisotropic")===!0){let D=t.get("EXT_texture_filter_anisotropic");s=i.getParameter(D.MAX_TEXTURE_MAX_ANISOTROPY_EXT)}else s=0;return s}function o(D){return!(D!==li&&n.convert(D)!==i.getParameter(i.IMPLEMENTATION_COLOR_READ_FORMAT))}function a(D){let U=D===Jr&&(t.has("EXT_color_buffer_half_float")||t.has("EXT_color_buffer_float"));return!(D!==Ni&&n.convert(D)!==i.getParameter(i.IMPLEMENTATION_COLOR_READ_TYPE)&&D!==bi&&!U)}function c(D){if(D==="highp"){if(i.getShaderPrecisionFormat(i.VERTEX_SHADER,i.HIGH_FLOAT).precision>0&&i.getShaderPrecisionFormat(i.FRAGMENT_SHADER,i.HIGH_FLOAT).precision>0)return"highp";D="mediump"}return D==="mediump"&&i.getShaderPrecisionFormat(i.VERTEX_SHADER,i.MEDIUM_FLOAT).precision>0&&i.getShaderPrecisionFormat(i.FRAGMENT_SHADER,i.MEDIUM_FLOAT).precision>0?"mediump":"lowp"}let l=e.precision!==void 0?e.precision:"highp",h=c(l);h!==l&&(console.warn("THREE.WebGLRenderer:",l,"not supported, using",h,"instead."),l=h);let u=e.logarithmicDepthBuffer===!0,d=e.reversedDepthBuffer===!0&&t.has("EXT_clip_control"),f=i.getParameter(i.MAX_TEXTURE_IMAGE_UNITS),g=i.getParameter(i.MAX_VERTEX_TEXTURE_IMAGE_UNITS),x=i.getParameter(i.MAX_TEXTURE_SIZE),m=i.getParameter(i.MAX_CUBE_MAP_TEXTURE_SIZE),p=i.getParameter(i.MAX_VERTEX_ATTRIBS),w=i.getParameter(i.MAX_VERTEX_UNIFORM_VECTORS),E=i.getParameter(i.MAX_VARYING_VECTORS),v=i.getParameter(i.MAX_FRAGMENT_UNIFORM_VECTORS),C=g>0,A=i.getParameter(i.MAX_SAMPLES);return{isWebGL2:!0,getMaxAnisotropy:r,getMaxPrecision:c,textureFormatReadable:o,textureTypeReadable:a,precision:l,logarithmicDepthBuffer:u,reversedDepthBuffer:d,maxTextures:f,maxVertexTextures:g,maxTextureSize:x,maxCubemapSize:m,maxAttributes:p,maxVertexUniforms:w,maxVaryings:E,maxFragmentUniforms:v,vertexTextures:C,maxSamples:A}}function PM(i){let t=this,e=null,n=0,s=!1,r=!1,o=new ri,a=new re,c={value:null,needsUpdate:!1};this.uniform=c,this.numPlanes=0,this.numIntersection=0,this.init=function(u,d){let f=u.length!==0||d||n!==0||s;return s=d,n=u.length,f},this.beginShadows=function(){r=!0,h(null)},this.endShadows=function(){r=!1},this.setGlobalState=function(u,d){e=h(u,d,0)},this.setState=function(u,d,f){let g=u.clippingPlanes,x=u.clipIntersection,m=u.clipShadows,p=i.get(u);if(!s||g===null||g.length===0||r&&!m)r?h(null):l();else{let w=r?0:n,E=w*4,v=p.clippingState||null;c.value=v,v=h(g,d,E,f);for(let C=0;C!==E;++C)v[C]=e[C];p.clippingState=v,this.numIntersection=x?this.numPlanes:0,this.numPlanes+=w}};function l(){c.value!==e&&(c.value=e,c.needsUpdate=n>0),t.numPlanes=n,t.numIntersection=0}function h(u,d,f,g){let x=u!==null?u.length:0,m=null;if(x!==0){if(m=c.value,g!==!0||m===null){let p=f+x*4,w=d.matrixWorldInverse;a.getNormalMatrix(w),(m===null||m.length<p)&&(m=new Float32Array(p));for(let E=0,v=f;E!==x;++E,v+=4)o.copy(u[E]).applyMatrix4(w,a),o.normal.toArray(m,v),m[v+3]=o.constant}c.value=m,c.needsUpdate=!0}return t.numPlanes=x,t.numIntersection=0,m}}function IM(i){let t=new WeakMap;function e(o,a){return a===Al?o.mapping=tr:a===Rl&&(o.mapping=er),o}function n(o){if(o&&o.isTexture){let a=o.mapping;if(a===Al||a===Rl)if(t.has(o)){let c=t.get(o).texture;return e(c,o.mapping)}else{let c=o.image;if(c&&c.height>0){let l=new rl(c.height);return l.fromEquirectangularTexture(i,o),t.set(o,l),o.addEventListener("dispose",s),e(l.texture,o.mapping)}else return null}}return o}function s(o){let a=o.target;a.removeEventListener("dispose",s);let c=t.get(a);c!==void 0&&(t.delete(a),c.dispose())}function r(){t=new WeakMap}return{get:n,dispose:r}}var to=4,um=[.125,.215,.35,.446,.526,.582],or=20,mu=new xl,dm=new jt,gu=null,_u=0,xu=0,yu=!1,rr=(1+Math.sqrt(5))/2,Qr=1/rr,fm=[new H(-rr,Qr,0),new H(rr,Qr,0),new H(-Qr,0,rr),new H(Qr,0,rr),new H(0,rr,-Qr),new H(0,rr,Qr),new H(-1,1,-1),new H(1,1,-1),new H(-1,1,1),new H(1,1,1)],LM=new H,pc=class{constructor(t){this._renderer=t,this._pingPongRenderTarget=null,this._lodMax=0,this._cubeSize=0,this._lodPlanes=[],this._sizeLods=[],this._sigmas=[],this._blurMaterial=null,this._cubemapMaterial=null,this._equirectMaterial=null,this._compileMaterial(this._blurMaterial)}fromScene(t,e=0,n=.1,s=100,r={}){let{size:o=256,position:a=LM}=r;gu=this._renderer.getRenderTarget(),_u=this._renderer.getActiveCubeFace(),xu=this._renderer.getActiveMipmapLevel(),yu=this._renderer.xr.enabled,this._renderer.xr.enabled=!1,this._setSize(o);let c=this._allocateTargets();return c.depthBuffer=!0,this._sceneToCubeUV(t,n,s,c,a),e>0&&this._blur(c,0,0,e),this._applyPMREM(c),this._cleanup(c),c}fromEquirectangular(t,e=null){return this._fromTexture(t,e)}fromCubemap(t,e=null){return this._fromTexture(t,e)}compileCubemapShader(){this._cubemapMaterial===null&&(this._cubemapMaterial=gm(),this._compileMaterial(this._cubemapMaterial))}compileEquirectangularShader(){this._equirectMaterial===null&&(this._equirectMaterial=mm(),this._compileMaterial(this._equirectMaterial))}dispose(){this._dispose(),this._cubemapMaterial!==null&&this._cubemapMaterial.dispose(),this._equirectMaterial!==null&&this._equirectMaterial.dispose()}_setSize(t){this._lodMax=Math.floor(Math.log2(t)),this._cubeSize=Math.pow(2,this._lodMax)}_dispose(){this._blurMaterial!==null&&this._blurMaterial.dispose(),this._pingPongRenderTarget!==null&&this._pingPongRenderTarget.dispose();for(let t=0;t<this._lodPlanes.length;t++)this._lodPlanes[t].dispose()}_cleanup(t){this._renderer.setRenderTarget(gu,_u,xu),this._renderer.xr.enabled=yu,t.scissorTest=!1,dc(t,0,0,t.width,t.height)}_fromTexture(t,e){t.mapping===tr||t.mapping===er?this._setSize(t.image.length===0?16:t.image[0].width||t.image[0].image.width):this._setSize(t.image.width/4),gu=this._renderer.getRenderTarget(),_u=this._renderer.getActiveCubeFace(),xu=this._renderer.getActiveMipmapLevel(),yu=this._renderer.xr.enabled,this._renderer.xr.enabled=!1;let n=e||this._allocateTargets();return this._textureToCubeUV(t,n),this._applyPMREM(n),this._cleanup(n),n}_allocateTargets(){let t=3*Math.max(this._cubeSize,112),e=4*this._cubeSize,n={magFilter:Mi,minFilter:Mi,generateMipmaps:!1,type:Jr,format:li,colorSpace:$s,depthBuffer:!1},s=pm(t,e,n);if(this._pingPongRenderTarget===null||this._pingPongRenderTarget.width!==t||this._pingPongRenderTarget.height!==e){this._pingPongRenderTarget!==null&&this._dispose(),this._pingPongRenderTarget=pm(t,e,n);let{_lodMax:r}=this;({sizeLods:this._sizeLods,lodPlanes:this._lodPlanes,sigmas:this._sigmas}=DM(r)),this._blurMaterial=NM(r,t,e)}return s}_compileMaterial(t){let e=new tn(this._lodPlanes[0],t);this._renderer.compile(e,mu)}_sceneToCubeUV(t,e,n,s,r){let c=new wn(90,1,e,n),l=[1,-1,1,1,1,1],h=[1,1,1,-1,-1,-1],u=this._renderer,d=u.autoClear,f=u.toneMapping;u.getClearColor(dm),u.toneMapping=ji,u.autoClear=!1,u.state.buffers.depth.getReversed()&&(u.setRenderTarget(s),u.clearDepth(),u.setRenderTarget(null));let x=new Js({name:"PMREM.Background",side:Fn,depthWrite:!1,depthTest:!1}),m=new tn(new ys,x),p=!1,w=t.background;w?w.isColor&&(x.color.copy(w),t.background=null,p=!0):(x.color.copy(dm),p=!0);for(let E=0;E<6;E++){let v=E%3;v===0?(c.up.set(0,l[E],0),c.position.set(r.x,r.y,r.z),c.lookAt(r.x+h[E],r.y,r.z)):v===1?(c.up.set(0,0,l[E]),c.position.set(r.x,r.y,r.z),c.lookAt(r.x,r.y+h[E],r.z)):(c.up.set(0,l[E],0),c.position.set(r.x,r.y,r.z),c.lookAt(r.x,r.y,r.z+h[E]));let C=this._cubeSize;dc(s,v*C,E>2?C:0,C,C),u.setRenderTarget(s),p&&u.render(m,c),u.render(t,c)}m.geometry.dispose(),m.material.dispose(),u.toneMapping=f,u.autoClear=d,t.background=w}_textureToCubeUV(t,e){let n=this._renderer,s=t.mapping===tr||t.mapping===er;s?(this._cubemapMaterial===null&&(this._cubemapMaterial=gm()),this._cubemapMaterial.uniforms.flipEnvMap.value=t.isRenderTargetTexture===!1?-1:1):this._equirectMaterial===null&&(this._equirectMaterial=mm());let r=s?this._cubemapMaterial:this._equirectMaterial,o=new tn(this._lodPlanes[0],r),a=r.uniforms;a.envMap.value=t;let c=this._cubeSize;dc(e,0,0,3*c,2*c),n.setRenderTarget(e),n.render(o,mu)}_applyPMREM(t){let e=this._renderer,n=e.autoClear;e.autoClear=!1;let s=this._lodPlanes.length;for(let r=1;r<s;r++){let o=Math.sqrt(this._sigmas[r]*this._sigmas[r]-this._sigmas[r-1]*this._sigmas[r-1]),a=fm[(s-r-1)%fm.length];this._blur(t,r-1,r,o,a)}e.autoClear=n}_blur(t,e,n,s,r){let o=this._pingPongRenderTarget;this._halfBlur(t,o,e,n,s,"latitudinal",r),this._halfBlur(o,t,n,n,s,"longitudinal",r)}_halfBlur(t,e,n,s,r,o,a){let c=this._renderer,l=this._blurMaterial;o!=="latitudinal"&&o!=="longitudinal"&&console.error("blur direction must be either latitudinal or longitudinal!");let h=3,u=new tn(this._lodPlanes[s],l),d=l.uniforms,f=this._sizeLods[n]-1,g=isFinite(r)?Math.PI/(2*f):2*Math.PI/(2*or-1),x=r/g,m=isFinite(r)?1+Math.floor(h*x):or;m>or&&console.warn(`sigmaRadians, ${r}, is too large and will clip, as it requested ${m} samples when the maximum is set to ${or}`);let p=[],w=0;for(let D=0;D<or;++D){let U=D/x,S=Math.exp(-U*U/2);p.push(S),D===0?w+=S:D<m&&(w+=2*S)}for(let D=0;D<p.length;D++)p[D]=p[D]/w;d.envMap.value=t.texture,d.samples.value=m,d.weights.value=p,d.latitudinal.value=o==="latitudinal",a&&(d.poleAxis.value=a);let{_lodMax:E}=this;d.dTheta.value=g,d.mipInt.value=E-n;let v=this._sizeLods[s],C=3*v*(s>E-to?s-E+to:0),A=4*(this._cubeSize-v);dc(e,C,A,3*v,2*v),c.setRenderTarget(e),c.render(u,mu)}};function DM(i){let t=[],e=[],n=[],s=i,r=i-to+1+um.length;for(let o=0;o<r;o++){let a=Math.pow(2,s);e.push(a);let c=1/a;o>i-to?c=um[o-i+to-1]:o===0&&(c=0),n.push(c);let l=1/(a-2),h=-l,u=1+l,d=[h,h,u,h,u,u,h,h,u,u,h,u],f=6,g=6,x=3,m=2,p=1,w=new Float32Array(x*g*f),E=new Float32Array(m*g*f),v=new Float32Array(p*g*f);for(let A=0;A<f;A++){let D=A%3*2/3-1,U=A>2?0:-1,S=[D,U,0,D+2/3,U,0,D+2/3,U+1,0,D,U,0,D+2/3,U+1,0,D,U+1,0];w.set(S,x*g*A),E.set(d,m*g*A);let b=[A,A,A,A,A,A];v.set(b,p*g*A)}let C=new Qe;C.setAttribute("position",new Oe(w,x)),C.setAttribute("uv",new Oe(E,m)),C.setAttribute("faceIndex",new Oe(v,p)),t.push(C),s>to&&s--}return{lodPlanes:t,sizeLods:e,sigmas:n}}function pm(i,t,e){let n=new Ii(i,t,e);return n.texture.mapping=Zo,n.texture.name="PMREM.cubeUv",n.scissorTest=!0,n}function dc(i,t,e,n,s){i.viewport.set(t,e,n,s),i.scissor.set(t,e,n,s)}function NM(i,t,e){let n=new Float32Array(or),s=new H(0,1,0);return new on({name:"SphericalGaussianBlur",defines:{n:or,CUBEUV_TEXEL_WIDTH:1/t,CUBEUV_TEXEL_HEIGHT:1/e,CUBEUV_MAX_MIP:`${i}.0`},uniforms:{envMap:{value:null},samples:{value:1},weights:{value:n},latitudinal:{value:!1},dTheta:{value:0},mipInt:{value:0},poleAxis:{value:s}},vertexShader:Cu(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			varying vec3 vOutputDirection;

			uniform sampler2D envMap;
			uniform int samples;
			uniform float weights[ n ];
			uniform bool latitudinal;
			uniform float dTheta;
			uniform float mipInt;
			uniform vec3 poleAxis;

			#define ENVMAP_TYPE_CUBE_UV
			#include <cube_uv_reflection_fragment>

			vec3 getSample( float theta, vec3 axis ) {

				float cosTheta = cos( theta );
				// Rodrigues' axis-angle rotation
				vec3 sampleDirection = vOutputDirection * cosTheta
					+ cross( axis, vOutputDirection ) * sin( theta )
					+ axis * dot( axis, vOutputDirection ) * ( 1.0 - cosTheta );

				return bilinearCubeUV( envMap, sampleDirection, mipInt );

			}

			void main() {

				vec3 axis = latitudinal ? poleAxis : cross( poleAxis, vOutputDirection );

				if ( all( equal( axis, vec3( 0.0 ) ) ) ) {

					axis = vec3( vOutputDirection.z, 0.0, - vOutputDirection.x );

				}

				axis = normalize( axis );

				gl_FragColor = vec4( 0.0, 0.0, 0.0, 1.0 );
				gl_FragColor.rgb += weights[ 0 ] * getSample( 0.0, axis );

				for ( int i = 1; i < n; i++ ) {

					if ( i >= samples ) {

						break;

					}

					float theta = dTheta * float( i );
					gl_FragColor.rgb += weights[ i ] * getSample( -1.0 * theta, axis );
					gl_FragColor.rgb += weights[ i ] * getSample( theta, axis );

				}

			}
		`,blending:Ki,depthTest:!1,depthWrite:!1})}function mm(){return new on({name:"EquirectangularToCubeUV",uniforms:{envMap:{value:null}},vertexShader:Cu(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			varying vec3 vOutputDirection;

			uniform sampler2D envMap;

			#include <common>

			void main() {

				vec3 outputDirection = normalize( vOutputDirection );
				vec2 uv = equirectUv( outputDirection );

				gl_FragColor = vec4( texture2D ( envMap, uv ).rgb, 1.0 );

			}
		`,blending:Ki,depthTest:!1,depthWrite:!1})}function gm(){return new on({name:"CubemapToCubeUV",uniforms:{envMap:{value:null},flipEnvMap:{value:-1}},vertexShader:Cu(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			uniform float flipEnvMap;

			varying vec3 vOutputDirection;

			uniform samplerCube envMap;

			void main() {

				gl_FragColor = textureCube( envMap, vec3( flipEnvMap * vOutputDirection.x, vOutputDirection.yz ) );

			}
		`,blending:Ki,depthTest:!1,depthWrite:!1})}function Cu(){return`

		precision mediump float;
		precision mediump int;

		attribute float faceIndex;

		varying vec3 vOutputDirection;

		// RH coordinate system; PMREM face-indexing convention
		vec3 getDirection( vec2 uv, float face ) {

			uv = 2.0 * uv - 1.0;

			vec3 direction = vec3( uv, 1.0 );

			if ( face == 0.0 ) {

				direction = direction.zyx; // ( 1, v, u ) pos x

			} else if ( face == 1.0 ) {

				direction = direction.xzy;
				direction.xz *= -1.0; // ( -u, 1, -v ) pos y

			} else if ( face == 2.0 ) {

				direction.x *= -1.0; // ( -u, v, 1 ) pos z

			} else if ( face == 3.0 ) {

				direction = direction.zyx;
				direction.xz *= -1.0; // ( -1, v, -u ) neg x

			} else if ( face == 4.0 ) {

				direction = direction.xzy;
				direction.xy *= -1.0; // ( -u, -1, v ) neg y

			} else if ( face == 5.0 ) {

				direction.z *= -1.0; // ( u, v, -1 ) neg z

			}

			return direction;

		}

		void main() {

			vOutputDirection = getDirection( uv, faceIndex );
			gl_Position = vec4( position, 1.0 );

		}
	`}function UM(i){let t=new WeakMap,e=null;function n(a){if(a&&a.isTexture){let c=a.mapping,l=c===Al||c===Rl,h=c===tr||c===er;if(l||h){let u=t.get(a),d=u!==void 0?u.texture.pmremVersion:0;if(a.isRenderTargetTexture&&a.pmremVersion!==d)return e===null&&(e=new pc(i)),u=l?e.fromEquirectangular(a,u):e.fromCubemap(a,u),u.texture.pmremVersion=a.pmremVersion,t.set(a,u),u.texture;if(u!==void 0)return u.texture;{let f=a.image;return l&&f&&f.height>0||h&&f&&s(f)?(e===null&&(e=new pc(i)),u=l?e.fromEquirectangular(a):e.fromCubemap(a),u.texture.pmremVersion=a.pmremVersion,t.set(a,u),a.addEventListener("dispose",r),u.texture):null}}}return a}function s(a){let c=0,l=6;for(let h=0;h<l;h++)a[h]!==void 0&&c++;return c===l}function r(a){let c=a.target;c.removeEventListener("dispose",r);let l=t.get(c);l!==void 0&&(t.delete(c),l.dispose())}function o(){t=new WeakMap,e!==null&&(e.dispose(),e=null)}return{get:n,dispose:o}}function FM(i){let t={};function e(n){if(t[n]!==void 0)return t[n];let s;switch(n){case"WEBGL_depth_texture":s=i.getExtension("WEBGL_depth_texture")||i.getExtension("MOZ_WEBGL_depth_texture")||i.getExtension("WEBKIT_WEBGL_depth_texture");break;case"EXT_texture_filter_anisotropic":s=i.getExtension("EXT_texture_filter_anisotropic")||i.getExtension("MOZ_EXT_texture_filter_anisotropic")||i.getExtension("WEBKIT_EXT_texture_filter_anisotropic");break;case"WEBGL_compressed_texture_s3tc":s=i.getExtension("WEBGL_compressed_texture_s3tc")||i.getExtension("MOZ_WEBGL_compressed_texture_s3tc")||i.getExtension("WEBKIT_WEBGL_compressed_texture_s3tc");break;case"WEBGL_compressed_texture_pvrtc":s=i.getExtension("WEBGL_compressed_texture_pvrtc")||i.getExtension("WEBKIT_WEBGL_compressed_texture_pvrtc");break;default:s=i.getExtension(n)}return t[n]=s,s}return{has:function(n){return e(n)!==null},init:function(){e("EXT_color_buffer_float"),e("WEBGL_clip_cull_distance"),e("OES_texture_float_linear"),e("EXT_color_buffer_half_float"),e("WEBGL_multisampled_render_to_texture"),e("WEBGL_render_shared_exponent")},get:function(n){let s=e(n);return s===null&&Gr("THREE.WebGLRenderer: "+n+" extension not supported."),s}}}function OM(i,t,e,n){let s={},r=new WeakMap;function o(u){let d=u.target;d.index!==null&&t.remove(d.index);for(let g in d.attributes)t.remove(d.attributes[g]);d.removeEventListener("dispose",o),delete s[d.id];let f=r.get(d);f&&(t.remove(f),r.delete(d)),n.releaseStatesOfGeometry(d),d.isInstancedBufferGeometry===!0&&delete d._maxInstanceCount,e.memory.geometries--}function a(u,d){return s[d.id]===!0||(d.addEventListener("dispose",o),s[d.id]=!0,e.memory.geometries++),d}function c(u){let d=u.attributes;for(let f in d)t.update(d[f],i.ARRAY_BUFFER)}function l(u){let d=[],f=u.index,g=u.attributes.position,x=0;if(f!==null){let w=f.array;x=f.version;for(let E=0,v=w.length;E<v;E+=3){let C=w[E+0],A=w[E+1],D=w[E+2];d.push(C,A,A,D,D,C)}}else if(g!==void 0){let w=g.array;x=g.version;for(let E=0,v=w.length/3-1;E<v;E+=3){let C=E+0,A=E+1,D=E+2;d.push(C,A,A,D,D,C)}}else return;let m=new(hu(d)?Oo:Fo)(d,1);m.version=x;let p=r.get(u);p&&t.remove(p),r.set(u,m)}function h(u){let d=r.get(u);if(d){let f=u.index;f!==null&&d.version<f.version&&l(u)}else l(u);return r.get(u)}return{get:a,update:c,getWireframeAttribute:h}}function BM(i,t,e){let n;function s(d){n=d}let r,o;function a(d){r=d.type,o=d.bytesPerElement}function c(d,f){i.drawElements(n,f,r,d*o),e.update(f,n,1)}function l(d,f,g){g!==0&&(i.drawElementsInstanced(n,f,r,d*o,g),e.update(f,n,g))}function h(d,f,g){if(g===0)return;t.get("WEBGL_multi_draw").multiDrawElementsWEBGL(n,f,0,r,d,0,g);let m=0;for(let p=0;p<g;p++)m+=f[p];e.update(m,n,1)}function u(d,f,g,x){if(g===0)return;let m=t.get("WEBGL_multi_draw");if(m===null)for(let p=0;p<d.length;p++)l(d[p]/o,f[p],x[p]);else{m.multiDrawElementsInstancedWEBGL(n,f,0,r,d,0,x,0,g);let p=0;for(let w=0;w<g;w++)p+=f[w]*x[w];e.update(p,n,1)}}this.setMode=s,this.setIndex=a,this.render=c,this.renderInstances=l,this.renderMultiDraw=h,this.renderMultiDrawInstances=u}function kM(i){let t={geometries:0,textures:0},e={frame:0,calls:0,triangles:0,points:0,lines:0};function n(r,o,a){switch(e.calls++,o){case i.TRIANGLES:e.triangles+=a*(r/3);break;case i.LINES:e.lines+=a*(r/2);break;case i.LINE_STRIP:e.lines+=a*(r-1);break;case i.LINE_LOOP:e.lines+=a*r;break;case i.POINTS:e.points+=a*r;break;default:console.error("THREE.WebGLInfo: Unknown draw mode:",o);break}}function s(){e.calls=0,e.triangles=0,e.points=0,e.lines=0}return{memory:t,render:e,programs:null,autoReset:!0,reset:s,update:n}}function zM(i,t,e){let n=new WeakMap,s=new Ze;function r(o,a,c){let l=o.morphTargetInfluences,h=a.morphAttributes.position||a.morphAttributes.normal||a.morphAttributes.color,u=h!==void 0?h.length:0,d=n.get(a);if(d===void 0||d.count!==u){let S=function(){D.dispose(),n.delete(a),a.removeEventListener("dispose",S)};d!==void 0&&d.texture.dispose();let f=a.morphAttributes.position!==void 0,g=a.morphAttributes.normal!==void 0,x=a.morphAttributes.color!==void 0,m=a.morphAttributes.position||[],p=a.morphAttributes.normal||[],w=a.morphAttributes.color||[],E=0;f===!0&&(E=1),g===!0&&(E=2),x===!0&&(E=3);let v=a.attributes.position.count*E,C=1;v>t.maxTextureSize&&(C=Math.ceil(v/t.maxTextureSize),v=t.maxTextureSize);let A=new Float32Array(v*C*4*u),D=new No(A,v,C,u);D.type=bi,D.needsUpdate=!0;let U=E*4;for(let b=0;b<u;b++){let P=m[b],O=p[b],z=w[b],W=v*C*4*b;for(let X=0;X<P.count;X++){let Y=X*U;f===!0&&(s.fromBufferAttribute(P,X),A[W+Y+0]=s.x,A[W+Y+1]=s.y,A[W+Y+2]=s.z,A[W+Y+3]=0),g===!0&&(s.fromBufferAttribute(O,X),A[W+Y+4]=s.x,A[W+Y+5]=s.y,A[W+Y+6]=s.z,A[W+Y+7]=0),x===!0&&(s.fromBufferAttribute(z,X),A[W+Y+8]=s.x,A[W+Y+9]=s.y,A[W+Y+10]=s.z,A[W+Y+11]=z.itemSize===4?s.w:1)}}d={count:u,texture:D,size:new Jt(v,C)},n.set(a,d),a.addEventListener("dispose",S)}if(o.isInstancedMesh===!0&&o.morphTexture!==null)c.getUniforms().setValue(i,"morphTexture",o.morphTexture,e);else{let f=0;for(let x=0;x<l.length;x++)f+=l[x];let g=a.morphTargetsRelative?1:1-f;c.getUniforms().setValue(i,"morphTargetBaseInfluence",g),c.getUniforms().setValue(i,"morphTargetInfluences",l)}c.getUniforms().setValue(i,"morphTargetsTexture",d.texture,e),c.getUniforms().setValue(i,"morphTargetsTextureSize",d.size)}return{update:r}}function VM(i,t,e,n){let s=new WeakMap;function r(c){let l=n.render.frame,h=c.geometry,u=t.get(c,h);if(s.get(u)!==l&&(t.update(u),s.set(u,l)),c.isInstancedMesh&&(c.hasEventListener("dispose",a)===!1&&c.addEventListener("dispose",a),s.get(c)!==l&&(e.update(c.instanceMatrix,i.ARRAY_BUFFER),c.instanceColor!==null&&e.update(c.instanceColor,i.ARRAY_BUFFER),s.set(c,l))),c.isSkinnedMesh){let d=c.skeleton;s.get(d)!==l&&(d.update(),s.set(d,l))}return u}function o(){s=new WeakMap}function a(c){let l=c.target;l.removeEventListener("dispose",a),e.remove(l.instanceMatrix),l.instanceColor!==null&&e.remove(l.instanceColor)}return{update:r,dispose:o}}var Um=new zn,_m=new Ho(1,1),Fm=new No,Om=new il,Bm=new ko,xm=[],ym=[],vm=new Float32Array(16),Mm=new Float32Array(9),bm=new Float32Array(4);function no(i,t,e){let n=i[0];if(n<=0||n>0)return i;let s=t*e,r=xm[s];if(r===void 0&&(r=new Float32Array(s),xm[s]=r),t!==0){n.toArray(r,0);for(let o=1,a=0;o!==t;++o)a+=e,i[o].toArray(r,a)}return r}function an(i,t){if(i.length!==t.length)return!1;for(let e=0,n=i.length;e<n;e++)if(i[e]!==t[e])return!1;return!0}function ln(i,t){for(let e=0,n=t.length;e<n;e++)i[e]=t[e]}function gc(i,t){let e=ym[t];e===void 0&&(e=new Int32Array(t),ym[t]=e);for(let n=0;n!==t;++n)e[n]=i.allocateTextureUnit();return e}function HM(i,t){let e=this.cache;e[0]!==t&&(i.uniform1f(this.addr,t),e[0]=t)}function GM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y)&&(i.uniform2f(this.addr,t.x,t.y),e[0]=t.x,e[1]=t.y);else{if(an(e,t))return;i.uniform2fv(this.addr,t),ln(e,t)}}function WM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z)&&(i.uniform3f(this.addr,t.x,t.y,t.z),e[0]=t.x,e[1]=t.y,e[2]=t.z);else if(t.r!==void 0)(e[0]!==t.r||e[1]!==t.g||e[2]!==t.b)&&(i.uniform3f(this.addr,t.r,t.g,t.b),e[0]=t.r,e[1]=t.g,e[2]=t.b);else{if(an(e,t))return;i.uniform3fv(this.addr,t),ln(e,t)}}function XM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z||e[3]!==t.w)&&(i.uniform4f(this.addr,t.x,t.y,t.z,t.w),e[0]=t.x,e[1]=t.y,e[2]=t.z,e[3]=t.w);else{if(an(e,t))return;i.uniform4fv(this.addr,t),ln(e,t)}}function qM(i,t){let e=this.cache,n=t.elements;if(n===void 0){if(an(e,t))return;i.uniformMatrix2fv(this.addr,!1,t),ln(e,t)}else{if(an(e,n))return;bm.set(n),i.uniformMatrix2fv(this.addr,!1,bm),ln(e,n)}}function YM(i,t){let e=this.cache,n=t.elements;if(n===void 0){if(an(e,t))return;i.uniformMatrix3fv(this.addr,!1,t),ln(e,t)}else{if(an(e,n))return;Mm.set(n),i.uniformMatrix3fv(this.addr,!1,Mm),ln(e,n)}}function $M(i,t){let e=this.cache,n=t.elements;if(n===void 0){if(an(e,t))return;i.uniformMatrix4fv(this.addr,!1,t),ln(e,t)}else{if(an(e,n))return;vm.set(n),i.uniformMatrix4fv(this.addr,!1,vm),ln(e,n)}}function ZM(i,t){let e=this.cache;e[0]!==t&&(i.uniform1i(this.addr,t),e[0]=t)}function JM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y)&&(i.uniform2i(this.addr,t.x,t.y),e[0]=t.x,e[1]=t.y);else{if(an(e,t))return;i.uniform2iv(this.addr,t),ln(e,t)}}function KM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z)&&(i.uniform3i(this.addr,t.x,t.y,t.z),e[0]=t.x,e[1]=t.y,e[2]=t.z);else{if(an(e,t))return;i.uniform3iv(this.addr,t),ln(e,t)}}function jM(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z||e[3]!==t.w)&&(i.uniform4i(this.addr,t.x,t.y,t.z,t.w),e[0]=t.x,e[1]=t.y,e[2]=t.z,e[3]=t.w);else{if(an(e,t))return;i.uniform4iv(this.addr,t),ln(e,t)}}function QM(i,t){let e=this.cache;e[0]!==t&&(i.uniform1ui(this.addr,t),e[0]=t)}function tb(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y)&&(i.uniform2ui(this.addr,t.x,t.y),e[0]=t.x,e[1]=t.y);else{if(an(e,t))return;i.uniform2uiv(this.addr,t),ln(e,t)}}function eb(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z)&&(i.uniform3ui(this.addr,t.x,t.y,t.z),e[0]=t.x,e[1]=t.y,e[2]=t.z);else{if(an(e,t))return;i.uniform3uiv(this.addr,t),ln(e,t)}}function nb(i,t){let e=this.cache;if(t.x!==void 0)(e[0]!==t.x||e[1]!==t.y||e[2]!==t.z||e[3]!==t.w)&&(i.uniform4ui(this.addr,t.x,t.y,t.z,t.w),e[0]=t.x,e[1]=t.y,e[2]=t.z,e[3]=t.w);else{if(an(e,t))return;i.uniform4uiv(this.addr,t),ln(e,t)}}function ib(i,t,e){let n=this.cache,s=e.allocateTextureUnit();n[0]!==s&&(i.uniform1i(this.addr,s),n[0]=s);let r;this.type===i.SAMPLER_2D_SHADOW?(_m.compareFunction=ou,r=_m):r=Um,e.setTexture2D(t||r,s)}function sb(i,t,e){let n=this.cache,s=e.allocateTextureUnit();n[0]!==s&&(i.uniform1i(this.addr,s),n[0]=s),e.setTexture3D(t||Om,s)}function rb(i,t,e){let n=this.cache,s=e.allocateTextureUnit();n[0]!==s&&(i.uniform1i(this.addr,s),n[0]=s),e.setTextureCube(t||Bm,s)}function ob(i,t,e){let n=this.cache,s=e.allocateTextureUnit();n[0]!==s&&(i.uniform1i(this.addr,s),n[0]=s),e.setTexture2DArray(t||Fm,s)}function ab(i){switch(i){case 5126:return HM;case 35664:return GM;case 35665:return WM;case 35666:return XM;case 35674:return qM;case 35675:return YM;case 35676:return $M;case 5124:case 35670:return ZM;case 35667:case 35671:return JM;case 35668:case 35672:return KM;case 35669:case 35673:return jM;case 5125:return QM;case 36294:return tb;case 36295:return eb;case 36296:return nb;case 35678:case 36198:case 36298:case 36306:case 35682:return ib;case 35679:case 36299:case 36307:return sb;case 35680:case 36300:case 36308:case 36293:return rb;case 36289:case 36303:case 36311:case 36292:return ob}}function lb(i,t){i.uniform1fv(this.addr,t)}function cb(i,t){let e=no(t,this.size,2);i.uniform2fv(this.addr,e)}function hb(i,t){let e=no(t,this.size,3);i.uniform3fv(this.addr,e)}function ub(i,t){let e=no(t,this.size,4);i.uniform4fv(this.addr,e)}function db(i,t){let e=no(t,this.size,4);i.uniformMatrix2fv(this.addr,!1,e)}function fb(i,t){let e=no(t,this.size,9);i.uniformMatrix3fv(this.addr,!1,e)}function pb(i,t){let e=no(t,this.size,16);i.uniformMatrix4fv(this.addr,!1,e)}function mb(i,t){i.uniform1iv(this.addr,t)}function gb(i,t){i.uniform2iv(this.addr,t)}function _b(i,t){i.uniform3iv(this.addr,t)}function xb(i,t){i.uniform4iv(this.addr,t)}function yb(i,t){i.uniform1uiv(this.addr,t)}function vb(i,t){i.uniform2uiv(this.addr,t)}function Mb(i,t){i.uniform3uiv(this.addr,t)}function bb(i,t){i.uniform4uiv(this.addr,t)}function Sb(i,t,e){let n=this.cache,s=t.length,r=gc(e,s);an(n,r)||(i.uniform1iv(this.addr,r),ln(n,r));for(let o=0;o!==s;++o)e.setTexture2D(t[o]||Um,r[o])}function wb(i,t,e){let n=this.cache,s=t.length,r=gc(e,s);an(n,r)||(i.uniform1iv(this.addr,r),ln(n,r));for(let o=0;o!==s;++o)e.setTexture3D(t[o]||Om,r[o])}function Eb(i,t,e){let n=this.cache,s=t.length,r=gc(e,s);an(n,r)||(i.uniform1iv(this.addr,r),ln(n,r));for(let o=0;o!==s;++o)e.setTextureCube(t[o]||Bm,r[o])}function Tb(i,t,e){let n=this.cache,s=t.length,r=gc(e,s);an(n,r)||(i.uniform1iv(this.addr,r),ln(n,r));for(let o=0;o!==s;++o)e.setTexture2DArray(t[o]||Fm,r[o])}function Ab(i){switch(i){case 5126:return lb;case 35664:return cb;case 35665:return hb;case 35666:return ub;case 35674:return db;case 35675:return fb;case 35676:return pb;case 5124:case 35670:return mb;case 35667:case 35671:return gb;case 35668:case 35672:return _b;case 35669:case 35673:return xb;case 5125:return yb;case 36294:return vb;case 36295:return Mb;case 36296:return bb;case 35678:case 36198:case 36298:case 36306:case 35682:return Sb;case 35679:case 36299:case 36307:return wb;case 35680:case 36300:case 36308:case 36293:return Eb;case 36289:case 36303:case 36311:case 36292:return Tb}}var Mu=class{constructor(t,e,n){this.id=t,this.addr=n,this.cache=[],this.type=e.type,this.setValue=ab(e.type)}},bu=class{constructor(t,e,n){this.id=t,this.addr=n,this.cache=[],this.type=e.type,this.size=e.size,this.setValue=Ab(e.type)}},Su=class{constructor(t){this.id=t,this.seq=[],this.map={}}setValue(t,e,n){let s=this.seq;for(let r=0,o=s.length;r!==o;++r){let a=s[r];a.setValue(t,e[a.id],n)}}},vu=/(\w+)(\])?(\[|\.)?/g;function Sm(i,t){i.seq.push(t),i.map[t.id]=t}function Rb(i,t,e){let n=i.name,s=n.length;for(vu.lastIndex=0;;){let r=vu.exec(n),o=vu.lastIndex,a=r[1],c=r[2]==="]",l=r[3];if(c&&(a=a|0),l===void 0||l==="["&&o+2===s){Sm(e,l===void 0?new Mu(a,i,t):new bu(a,i,t));break}else{let u=e.map[a];u===void 0&&(u=new Su(a),Sm(e,u)),e=u}}}var eo=class{constructor(t,e){this.seq=[],this.map={};let n=t.getProgramParameter(e,t.ACTIVE_UNIFORMS);for(let s=0;s<n;++s){let r=t.getActiveUniform(e,s),o=t.getUniformLocation(e,r.name);Rb(r,o,this)}}setValue(t,e,n,s){let r=this.map[e];r!==void 0&&r.setValue(t,n,s)}setOptional(t,e,n){let s=e[n];s!==void 0&&this.setValue(t,n,s)}static upload(t,e,n,s){for(let r=0,o=e.length;r!==o;++r){let a=e[r],c=n[a.id];c.needsUpdate!==!1&&a.setValue(t,c.value,s)}}static seqWithValue(t,e){let n=[];for(let s=0,r=t.length;s!==r;++s){let o=t[s];o.id in e&&n.push(o)}return n}};function wm(i,t,e){let n=i.createShader(t);return i.shaderSource(n,e),i.compileShader(n),n}var Cb=37297,Pb=0;function Ib(i,t){let e=i.split(`
`),n=[],s=Math.max(t-6,0),r=Math.min(t+6,e.length);for(let o=s;o<r;o++){let a=o+1;n.push(`${a===t?">":" "} ${a}: ${e[o]}`)}return n.join(`
`)}var Em=new re;function Lb(i){fe._getMatrix(Em,fe.workingColorSpace,i);let t=`mat3( ${Em.elements.map(e=>e.toFixed(4))} )`;switch(fe.getTransfer(i)){case Io:return[t,"LinearTransferOETF"];case Ee:return[t,"sRGBTransferOETF"];default:return console.warn("THREE.WebGLProgram: Unsupported color space: ",i),[t,"LinearTransferOETF"]}}function Tm(i,t,e){let n=i.getShaderParameter(t,i.COMPILE_STATUS),r=(i.getShaderInfoLog(t)||"").trim();if(n&&r==="")return"";let o=/ERROR: 0:(\d+)/.exec(r);if(o){let a=parseInt(o[1]);return e.toUpperCase()+`

`+r+`

`+Ib(i.getShaderSource(t),a)}else return r}function Db(i,t){let e=Lb(t);return[`vec4 ${i}( vec4 value ) {`,`	return ${e[1]}( vec4( value.rgb * ${e[0]}, value.a ) );`,"}"].join(`
`)}function Nb(i,t){let e;switch(t){case Vp:e="Linear";break;case Hp:e="Reinhard";break;case Gp:e="Cineon";break;case Wp:e="ACESFilmic";break;case qp:e="AgX";break;case Yp:e="Neutral";break;case Xp:e="Custom";break;default:console.warn("THREE.WebGLProgram: Unsupported toneMapping:",t),e="Linear"}return"vec3 "+i+"( vec3 color ) { return "+e+"ToneMapping( color ); }"}var fc=new H;function Ub(){fe.getLuminanceCoefficients(fc);let i=fc.x.toFixed(4),t=fc.y.toFixed(4),e=fc.z.toFixed(4);return["float luminance( const in vec3 rgb ) {",`	const vec3 weights = vec3( ${i}, ${t}, ${e} );`,"	return dot( weights, rgb );","}"].join(`
`)}function Fb(i){return[i.extensionClipCullDistance?"#extension GL_ANGLE_clip_cull_distance : require":"",i.extensionMultiDraw?"#extension GL_ANGLE_multi_draw : require":""].filter(ea).join(`
`)}function Ob(i){let t=[];for(let e in i){let n=i[e];n!==!1&&t.push("#define "+e+" "+n)}return t.join(`
`)}function Bb(i,t){let e={},n=i.getProgramParameter(t,i.ACTIVE_ATTRIBUTES);for(let s=0;s<n;s++){let r=i.getActiveAttrib(t,s),o=r.name,a=1;r.type===i.FLOAT_MAT2&&(a=2),r.type===i.FLOAT_MAT3&&(a=3),r.type===i.FLOAT_MAT4&&(a=4),e[o]={type:r.type,location:i.getAttribLocation(t,o),locationSize:a}}return e}function ea(i){return i!==""}function Am(i,t){let e=t.numSpotLightShadows+t.numSpotLightMaps-t.numSpotLightShadowsWithMaps;return i.replace(/NUM_DIR_LIGHTS/g,t.numDirLights).replace(/NUM_SPOT_LIGHTS/g,t.numSpotLights).replace(/NUM_SPOT_LIGHT_MAPS/g,t.numSpotLightMaps).replace(/NUM_SPOT_LIGHT_COORDS/g,e).replace(/NUM_RECT_AREA_LIGHTS/g,t.numRectAreaLights).replace(/NUM_POINT_LIGHTS/g,t.numPointLights).replace(/NUM_HEMI_LIGHTS/g,t.numHemiLights).replace(/NUM_DIR_LIGHT_SHADOWS/g,t.numDirLightShadows).replace(/NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS/g,t.numSpotLightShadowsWithMaps).replace(/NUM_SPOT_LIGHT_SHADOWS/g,t.numSpotLightShadows).replace(/NUM_POINT_LIGHT_SHADOWS/g,t.numPointLightShadows)}function Rm(i,t){return i.replace(/NUM_CLIPPING_PLANES/g,t.numClippingPlanes).replace(/UNION_CLIPPING_PLANES/g,t.numClippingPlanes-t.numClipIntersection)}var kb=/^[ \t]*#include +<([\w\d./]+)>/gm;function wu(i){return i.replace(kb,Vb)}var zb=new Map;function Vb(i,t){let e=ae[t];if(e===void 0){let n=zb.get(t);if(n!==void 0)e=ae[n],console.warn('THREE.WebGLRenderer: Shader chunk "%s" has been deprecated. Use "%s" instead.',t,n);else throw new Error("Can not resolve #include <"+t+">")}return wu(e)}var Hb=/#pragma unroll_loop_start\s+for\s*\(\s*int\s+i\s*=\s*(\d+)\s*;\s*i\s*<\s*(\d+)\s*;\s*i\s*\+\+\s*\)\s*{([\s\S]+?)}\s+#pragma unroll_loop_end/g;function Cm(i){return i.replace(Hb,Gb)}function Gb(i,t,e,n){let s="";for(let r=parseInt(t);r<parseInt(e);r++)s+=n.replace(/\[\s*i\s*\]/g,"[ "+r+" ]").replace(/UNROLLED_LOOP_INDEX/g,r);return s}function Pm(i){let t=`precision ${i.precision} float;
	precision ${i.precision} int;
	precision ${i.precision} sampler2D;
	precision ${i.precision} samplerCube;
	precision ${i.precision} sampler3D;
	precision ${i.precision} sampler2DArray;
	precision ${i.precision} sampler2DShadow;
	precision ${i.precision} samplerCubeShadow;
	precision ${i.precision} sampler2DArrayShadow;
	precision ${i.precision} isampler2D;
	precision ${i.precision} isampler3D;
	precision ${i.precision} isamplerCube;
	precision ${i.precision} isampler2DArray;
	precision ${i.precision} usampler2D;
	precision ${i.precision} usampler3D;
	precision ${i.precision} usamplerCube;
	precision ${i.precision} usampler2DArray;
	`;return i.precision==="highp"?t+=`
#define HIGH_PRECISION`:i.precision==="mediump"?t+=`
#define MEDIUM_PRECISION`:i.precision==="lowp"&&(t+=`
#define LOW_PRECISION`),t}function Wb(i){let t="SHADOWMAP_TYPE_BASIC";return i.shadowMapType===Yh?t="SHADOWMAP_TYPE_PCF":i.shadowMapType===vp?t="SHADOWMAP_TYPE_PCF_SOFT":i.shadowMapType===Di&&(t="SHADOWMAP_TYPE_VSM"),t}function Xb(i){let t="ENVMAP_TYPE_CUBE";if(i.envMap)switch(i.envMapMode){case tr:case er:t="ENVMAP_TYPE_CUBE";break;case Zo:t="ENVMAP_TYPE_CUBE_UV";break}return t}function qb(i){let t="ENVMAP_MODE_REFLECTION";if(i.envMap)switch(i.envMapMode){case er:t="ENVMAP_MODE_REFRACTION";break}return t}function Yb(i){let t="ENVMAP_BLENDING_NONE";if(i.envMap)switch(i.combine){case Kh:t="ENVMAP_BLENDING_MULTIPLY";break;case kp:t="ENVMAP_BLENDING_MIX";break;case zp:t="ENVMAP_BLENDING_ADD";break}return t}function $b(i){let t=i.envMapCubeUVHeight;if(t===null)return null;let e=Math.log2(t)-2,n=1/t;return{texelWidth:1/(3*Math.max(Math.pow(2,e),112)),texelHeight:n,maxMip:e}}function Zb(i,t,e,n){let s=i.getContext(),r=e.defines,o=e.vertexShader,a=e.fragmentShader,c=Wb(e),l=Xb(e),h=qb(e),u=Yb(e),d=$b(e),f=Fb(e),g=Ob(r),x=s.createProgram(),m,p,w=e.glslVersion?"#version "+e.glslVersion+`
`:"";e.isRawShaderMaterial?(m=["#define SHADER_TYPE "+e.shaderType,"#define SHADER_NAME "+e.shaderName,g].filter(ea).join(`
`),m.length>0&&(m+=`
`),p=["#define SHADER_TYPE "+e.shaderType,"#define SHADER_NAME "+e.shaderName,g].filter(ea).join(`
`),p.length>0&&(p+=`
`)):(m=[Pm(e),"#define SHADER_TYPE "+e.shaderType,"#define SHADER_NAME "+e.shaderName,g,e.extensionClipCullDistance?"#define USE_CLIP_DISTANCE":"",e.batching?"#define USE_BATCHING":"",e.batchingColor?"#define USE_BATCHING_COLOR":"",e.instancing?"#define USE_INSTANCING":"",e.instancingColor?"#define USE_INSTANCING_COLOR":"",e.instancingMorph?"#define USE_INSTANCING_MORPH":"",e.useFog&&e.fog?"#define USE_FOG":"",e.useFog&&e.fogExp2?"#define FOG_EXP2":"",e.map?"#define USE_MAP":"",e.envMap?"#define USE_ENVMAP":"",e.envMap?"#define "+h:"",e.lightMap?"#define USE_LIGHTMAP":"",e.aoMap?"#define USE_AOMAP":"",e.bumpMap?"#define USE_BUMPMAP":"",e.normalMap?"#define USE_NORMALMAP":"",e.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",e.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",e.displacementMap?"#define USE_DISPLACEMENTMAP":"",e.emissiveMap?"#define USE_EMISSIVEMAP":"",e.anisotropy?"#define USE_ANISOTROPY":"",e.anisotropyMap?"#define USE_ANISOTROPYMAP":"",e.clearcoatMap?"#define USE_CLEARCOATMAP":"",e.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",e.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",e.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",e.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",e.specularMap?"#define USE_SPECULARMAP":"",e.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",e.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",e.roughnessMap?"#define USE_ROUGHNESSMAP":"",e.metalnessMap?"#define USE_METALNESSMAP":"",e.alphaMap?"#define USE_ALPHAMAP":"",e.alphaHash?"#define USE_ALPHAHASH":"",e.transmission?"#define USE_TRANSMISSION":"",e.transmissionMap?"#define USE_TRANSMISSIONMAP":"",e.thicknessMap?"#define USE_THICKNESSMAP":"",e.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",e.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",e.mapUv?"#define MAP_UV "+e.mapUv:"",e.alphaMapUv?"#define ALPHAMAP_UV "+e.alphaMapUv:"",e.lightMapUv?"#define LIGHTMAP_UV "+e.lightMapUv:"",e.aoMapUv?"#define AOMAP_UV "+e.aoMapUv:"",e.emissiveMapUv?"#define EMISSIVEMAP_UV "+e.emissiveMapUv:"",e.bumpMapUv?"#define BUMPMAP_UV "+e.bumpMapUv:"",e.normalMapUv?"#define NORMALMAP_UV "+e.normalMapUv:"",e.displacementMapUv?"#define DISPLACEMENTMAP_UV "+e.displacementMapUv:"",e.metalnessMapUv?"#define METALNESSMAP_UV "+e.metalnessMapUv:"",e.roughnessMapUv?"#define ROUGHNESSMAP_UV "+e.roughnessMapUv:"",e.anisotropyMapUv?"#define ANISOTROPYMAP_UV "+e.anisotropyMapUv:"",e.clearcoatMapUv?"#define CLEARCOATMAP_UV "+e.clearcoatMapUv:"",e.clearcoatNormalMapUv?"#define CLEARCOAT_NORMALMAP_UV "+e.clearcoatNormalMapUv:"",e.clearcoatRoughnessMapUv?"#define CLEARCOAT_ROUGHNESSMAP_UV "+e.clearcoatRoughnessMapUv:"",e.iridescenceMapUv?"#define IRIDESCENCEMAP_UV "+e.iridescenceMapUv:"",e.iridescenceThicknessMapUv?"#define IRIDESCENCE_THICKNESSMAP_UV "+e.iridescenceThicknessMapUv:"",e.sheenColorMapUv?"#define SHEEN_COLORMAP_UV "+e.sheenColorMapUv:"",e.sheenRoughnessMapUv?"#define SHEEN_ROUGHNESSMAP_UV "+e.sheenRoughnessMapUv:"",e.specularMapUv?"#define SPECULARMAP_UV "+e.specularMapUv:"",e.specularColorMapUv?"#define SPECULAR_COLORMAP_UV "+e.specularColorMapUv:"",e.specularIntensityMapUv?"#define SPECULAR_INTENSITYMAP_UV "+e.specularIntensityMapUv:"",e.transmissionMapUv?"#define TRANSMISSIONMAP_UV "+e.transmissionMapUv:"",e.thicknessMapUv?"#define THICKNESSMAP_UV "+e.thicknessMapUv:"",e.vertexTangents&&e.flatShading===!1?"#define USE_TANGENT":"",e.vertexColors?"#define USE_COLOR":"",e.vertexAlphas?"#define USE_COLOR_ALPHA":"",e.vertexUv1s?"#define USE_UV1":"",e.vertexUv2s?"#define USE_UV2":"",e.vertexUv3s?"#define USE_UV3":"",e.pointsUvs?"#define USE_POINTS_UV":"",e.flatShading?"#define FLAT_SHADED":"",e.skinning?"#define USE_SKINNING":"",e.morphTargets?"#define USE_MORPHTARGETS":"",e.morphNormals&&e.flatShading===!1?"#define USE_MORPHNORMALS":"",e.morphColors?"#define USE_MORPHCOLORS":"",e.morphTargetsCount>0?"#define MORPHTARGETS_TEXTURE_STRIDE "+e.morphTextureStride:"",e.morphTargetsCount>0?"#define MORPHTARGETS_COUNT "+e.morphTargetsCount:"",e.doubleSided?"#define DOUBLE_SIDED":"",e.flipSided?"#define FLIP_SIDED":"",e.shadowMapEnabled?"#define USE_SHADOWMAP":"",e.shadowMapEnabled?"#define "+c:"",e.sizeAttenuation?"#define USE_SIZEATTENUATION":"",e.numLightProbes>0?"#define USE_LIGHT_PROBES":"",e.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",e.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 modelMatrix;","uniform mat4 modelViewMatrix;","uniform mat4 projectionMatrix;","uniform mat4 viewMatrix;","uniform mat3 normalMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;","#ifdef USE_INSTANCING","	attribute mat4 instanceMatrix;","#endif","#ifdef USE_INSTANCING_COLOR","	attribute vec3 instanceColor;","#endif","#ifdef USE_INSTANCING_MORPH","	uniform sampler2D morphTexture;","#endif","attribute vec3 position;","attribute vec3 normal;","attribute vec2 uv;","#ifdef USE_UV1","	attribute vec2 uv1;","#endif","#ifdef USE_UV2","	attribute vec2 uv2;","#endif","#ifdef USE_UV3","	attribute vec2 uv3;","#endif","#ifdef USE_TANGENT","	attribute vec4 tangent;","#endif","#if defined( USE_COLOR_ALPHA )","	attribute vec4 color;","#elif defined( USE_COLOR )","	attribute vec3 color;","#endif","#ifdef USE_SKINNING","	attribute vec4 skinIndex;","	attribute vec4 skinWeight;","#endif",`
`].filter(ea).join(`
`),p=[Pm(e),"#define SHADER_TYPE "+e.shaderType,"#define SHADER_NAME "+e.shaderName,g,e.useFog&&e.fog?"#define USE_FOG":"",e.useFog&&e.fogExp2?"#define FOG_EXP2":"",e.alphaToCoverage?"#define ALPHA_TO_COVERAGE":"",e.map?"#define USE_MAP":"",e.matcap?"#define USE_MATCAP":"",e.envMap?"#define USE_ENVMAP":"",e.envMap?"#define "+l:"",e.envMap?"#define "+h:"",e.envMap?"#define "+u:"",d?"#define CUBEUV_TEXEL_WIDTH "+d.texelWidth:"",d?"#define CUBEUV_TEXEL_HEIGHT "+d.texelHeight:"",d?"#define CUBEUV_MAX_MIP "+d.maxMip+".0":"",e.lightMap?"#define USE_LIGHTMAP":"",e.aoMap?"#define USE_AOMAP":"",e.bumpMap?"#define USE_BUMPMAP":"",e.normalMap?"#define USE_NORMALMAP":"",e.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",e.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",e.emissiveMap?"#define USE_EMISSIVEMAP":"",e.anisotropy?"#define USE_ANISOTROPY":"",e.anisotropyMap?"#define USE_ANISOTROPYMAP":"",e.clearcoat?"#define USE_CLEARCOAT":"",e.clearcoatMap?"#define USE_CLEARCOATMAP":"",e.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",e.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",e.dispersion?"#define USE_DISPERSION":"",e.iridescence?"#define USE_IRIDESCENCE":"",e.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",e.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",e.specularMap?"#define USE_SPECULARMAP":"",e.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",e.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",e.roughnessMap?"#define USE_ROUGHNESSMAP":"",e.metalnessMap?"#define USE_METALNESSMAP":"",e.alphaMap?"#define USE_ALPHAMAP":"",e.alphaTest?"#define USE_ALPHATEST":"",e.alphaHash?"#define USE_ALPHAHASH":"",e.sheen?"#define USE_SHEEN":"",e.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",e.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",e.transmission?"#define USE_TRANSMISSION":"",e.transmissionMap?"#define USE_TRANSMISSIONMAP":"",e.thicknessMap?"#define USE_THICKNESSMAP":"",e.vertexTangents&&e.flatShading===!1?"#define USE_TANGENT":"",e.vertexColors||e.instancingColor||e.batchingColor?"#define USE_COLOR":"",e.vertexAlphas?"#define USE_COLOR_ALPHA":"",e.vertexUv1s?"#define USE_UV1":"",e.vertexUv2s?"#define USE_UV2":"",e.vertexUv3s?"#define USE_UV3":"",e.pointsUvs?"#define USE_POINTS_UV":"",e.gradientMap?"#define USE_GRADIENTMAP":"",e.flatShading?"#define FLAT_SHADED":"",e.doubleSided?"#define DOUBLE_SIDED":"",e.flipSided?"#define FLIP_SIDED":"",e.shadowMapEnabled?"#define USE_SHADOWMAP":"",e.shadowMapEnabled?"#define "+c:"",e.premultipliedAlpha?"#define PREMULTIPLIED_ALPHA":"",e.numLightProbes>0?"#define USE_LIGHT_PROBES":"",e.decodeVideoTexture?"#define DECODE_VIDEO_TEXTURE":"",e.decodeVideoTextureEmissive?"#define DECODE_VIDEO_TEXTURE_EMISSIVE":"",e.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",e.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 viewMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;",e.toneMapping!==ji?"#define TONE_MAPPING":"",e.toneMapping!==ji?ae.tonemapping_pars_fragment:"",e.toneMapping!==ji?Nb("toneMapping",e.toneMapping):"",e.dithering?"#define DITHERING":"",e.opaque?"#define OPAQUE":"",ae.colorspace_pars_fragment,Db("linearToOutputTexel",e.outputColorSpace),Ub(),e.useDepthPacking?"#define DEPTH_PACKING "+e.depthPacking:"",`
`].filter(ea).join(`
`)),o=wu(o),o=Am(o,e),o=Rm(o,e),a=wu(a),a=Am(a,e),a=Rm(a,e),o=Cm(o),a=Cm(a),e.isRawShaderMaterial!==!0&&(w=`#version 300 es
`,m=[f,"#define attribute in","#define varying out","#define texture2D texture"].join(`
`)+`
`+m,p=["#define varying in",e.glslVersion===au?"":"layout(location = 0) out highp vec4 pc_fragColor;",e.glslVersion===au?"":"#define gl_FragColor pc_fragColor","#define gl_FragDepthEXT gl_FragDepth","#define texture2D texture","#define textureCube texture","#define texture2DProj textureProj","#define texture2DLodEXT textureLod","#define texture2DProjLodEXT textureProjLod","#define textureCubeLodEXT textureLod","#define texture2DGradEXT textureGrad","#define texture2DProjGradEXT textureProjGrad","#define textureCubeGradEXT textureGrad"].join(`
`)+`
`+p);let E=w+m+o,v=w+p+a,C=wm(s,s.VERTEX_SHADER,E),A=wm(s,s.FRAGMENT_SHADER,v);s.attachShader(x,C),s.attachShader(x,A),e.index0AttributeName!==void 0?s.bindAttribLocation(x,0,e.index0AttributeName):e.morphTargets===!0&&s.bindAttribLocation(x,0,"position"),s.linkProgram(x);function D(P){if(i.debug.checkShaderErrors){let O=s.getProgramInfoLog(x)||"",z=s.getShaderInfoLog(C)||"",W=s.getShaderInfoLog(A)||"",X=O.trim(),Y=z.trim(),j=W.trim(),K=!0,at=!0;if(s.getProgramParameter(x,s.LINK_STATUS)===!1)if(K=!1,typeof i.debug.onShaderError=="function")i.debug.onShaderError(s,x,C,A);else{let lt=Tm(s,C,"vertex"),xt=Tm(s,A,"fragment");console.error("THREE.WebGLProgram: Shader Error "+s.getError()+" - VALIDATE_STATUS "+s.getProgramParameter(x,s.VALIDATE_STATUS)+`

Material Name: `+P.name+`
Material Type: `+P.type+`

Program Info Log: `+X+`
`+lt+`
`+xt)}else X!==""?console.warn("THREE.WebGLProgram: Program Info Log:",X):(Y===""||j==="")&&(at=!1);at&&(P.diagnostics={runnable:K,programLog:X,vertexShader:{log:Y,prefix:m},fragmentShader:{log:j,prefix:p}})}s.deleteShader(C),s.deleteShader(A),U=new eo(s,x),S=Bb(s,x)}let U;this.getUniforms=function(){return U===void 0&&D(this),U};let S;this.getAttributes=function(){return S===void 0&&D(this),S};let b=e.rendererExtensionParallelShaderCompile===!1;return this.isReady=function(){return b===!1&&(b=s.getProgramParameter(x,Cb)),b},this.destroy=function(){n.releaseStatesOfProgram(this),s.deleteProgram(x),this.program=void 0},this.type=e.shaderType,this.name=e.shaderName,this.id=Pb++,this.cacheKey=t,this.usedTimes=1,this.program=x,this.vertexShader=C,this.fragmentShader=A,this}var Jb=0,Eu=class{constructor(){this.shaderCache=new Map,this.materialCache=new Map}update(t){let e=t.vertexShader,n=t.fragmentShader,s=this._getShaderStage(e),r=this._getShaderStage(n),o=this._getShaderCacheForMaterial(t);return o.has(s)===!1&&(o.add(s),s.usedTimes++),o.has(r)===!1&&(o.add(r),r.usedTimes++),this}remove(t){let e=this.materialCache.get(t);for(let n of e)n.usedTimes--,n.usedTimes===0&&this.shaderCache.delete(n.code);return this.materialCache.delete(t),this}getVertexShaderID(t){return this._getShaderStage(t.vertexShader).id}getFragmentShaderID(t){return this._getShaderStage(t.fragmentShader).id}dispose(){this.shaderCache.clear(),this.materialCache.clear()}_getShaderCacheForMaterial(t){let e=this.materialCache,n=e.get(t);return n===void 0&&(n=new Set,e.set(t,n)),n}_getShaderStage(t){let e=this.shaderCache,n=e.get(t);return n===void 0&&(n=new Tu(t),e.set(t,n)),n}},Tu=class{constructor(t){this.id=Jb++,this.code=t,this.usedTimes=0}};function Kb(i,t,e,n,s,r,o){let a=new Uo,c=new Eu,l=new Set,h=[],u=s.logarithmicDepthBuffer,d=s.vertexTextures,f=s.precision,g={MeshDepthMaterial:"depth",MeshDistanceMaterial:"distanceRGBA",MeshNormalMaterial:"normal",MeshBasicMaterial:"basic",MeshLambertMaterial:"lambert",MeshPhongMaterial:"phong",MeshToonMaterial:"toon",MeshStandardMaterial:"physical",MeshPhysicalMaterial:"physical",MeshMatcapMaterial:"matcap",LineBasicMaterial:"basic",LineDashedMaterial:"dashed",PointsMaterial:"points",ShadowMaterial:"shadow",SpriteMaterial:"sprite"};function x(S){return l.add(S),S===0?"uv":`uv${S}`}function m(S,b,P,O,z){let W=O.fog,X=z.geometry,Y=S.isMeshStandardMaterial?O.environment:null,j=(S.isMeshStandardMaterial?e:t).get(S.envMap||Y),K=j&&j.mapping===Zo?j.image.height:null,at=g[S.type];S.precision!==null&&(f=s.getMaxPrecision(S.precision),f!==S.precision&&console.warn("THREE.WebGLProgram.getParameters:",S.precision,"not supported, using",f,"instead."));let lt=X.morphAttributes.position||X.morphAttributes.normal||X.morphAttributes.color,xt=lt!==void 0?lt.length:0,Mt=0;X.morphAttributes.position!==void 0&&(Mt=1),X.morphAttributes.normal!==void 0&&(Mt=2),X.morphAttributes.color!==void 0&&(Mt=3);let _t,ie,Qt,Q;if(at){let pe=Ui[at];_t=pe.vertexShader,ie=pe.fragmentShader}else _t=S.vertexShader,ie=S.fragmentShader,c.update(S),Qt=c.getVertexShaderID(S),Q=c.getFragmentShaderID(S);let et=i.getRenderTarget(),wt=i.state.buffers.depth.getReversed(),kt=z.isInstancedMesh===!0,yt=z.isBatchedMesh===!0,te=!!S.map,De=!!S.matcap,N=!!j,de=!!S.aoMap,$t=!!S.lightMap,Gt=!!S.bumpMap,Nt=!!S.normalMap,be=!!S.displacementMap,Ct=!!S.emissiveMap,Ht=!!S.metalnessMap,Be=!!S.roughnessMap,xe=S.anisotropy>0,I=S.clearcoat>0,y=S.dispersion>0,F=S.iridescence>0,Z=S.sheen>0,nt=S.transmission>0,tt=xe&&!!S.anisotropyMap,Ut=I&&!!S.clearcoatMap,ut=I&&!!S.clearcoatNormalMap,It=I&&!!S.clearcoatRoughnessMap,At=F&&!!S.iridescenceMap,ot=F&&!!S.iridescenceThicknessMap,gt=Z&&!!S.sheenColorMap,Bt=Z&&!!S.sheenRoughnessMap,Ot=!!S.specularMap,vt=!!S.specularColorMap,Kt=!!S.specularIntensityMap,B=nt&&!!S.transmissionMap,dt=nt&&!!S.thicknessMap,pt=!!S.gradientMap,Pt=!!S.alphaMap,ht=S.alphaTest>0,rt=!!S.alphaHash,Ft=!!S.extensions,ee=ji;S.toneMapped&&(et===null||et.isXRRenderTarget===!0)&&(ee=i.toneMapping);let Te={shaderID:at,shaderType:S.type,shaderName:S.name,vertexShader:_t,fragmentShader:ie,defines:S.defines,customVertexShaderID:Qt,customFragmentShaderID:Q,isRawShaderMaterial:S.isRawShaderMaterial===!0,glslVersion:S.glslVersion,precision:f,batching:yt,batchingColor:yt&&z._colorsTexture!==null,instancing:kt,instancingColor:kt&&z.instanceColor!==null,instancingMorph:kt&&z.morphTexture!==null,supportsVertexTextures:d,outputColorSpace:et===null?i.outputColorSpace:et.isXRRenderTarget===!0?et.texture.colorSpace:$s,alphaToCoverage:!!S.alphaToCoverage,map:te,matcap:De,envMap:N,envMapMode:N&&j.mapping,envMapCubeUVHeight:K,aoMap:de,lightMap:$t,bumpMap:Gt,normalMap:Nt,displacementMap:d&&be,emissiveMap:Ct,normalMapObjectSpace:Nt&&S.normalMapType===jp,normalMapTangentSpace:Nt&&S.normalMapType===Kp,metalnessMap:Ht,roughnessMap:Be,anisotropy:xe,anisotropyMap:tt,clearcoat:I,clearcoatMap:Ut,clearcoatNormalMap:ut,clearcoatRoughnessMap:It,dispersion:y,iridescence:F,iridescenceMap:At,iridescenceThicknessMap:ot,sheen:Z,sheenColorMap:gt,sheenRoughnessMap:Bt,specularMap:Ot,specularColorMap:vt,specularIntensityMap:Kt,transmission:nt,transmissionMap:B,thicknessMap:dt,gradientMap:pt,opaque:S.transparent===!1&&S.blending===qs&&S.alphaToCoverage===!1,alphaMap:Pt,alphaTest:ht,alphaHash:rt,combine:S.combine,mapUv:te&&x(S.map.channel),aoMapUv:de&&x(S.aoMap.channel),lightMapUv:$t&&x(S.lightMap.channel),bumpMapUv:Gt&&x(S.bumpMap.channel),normalMapUv:Nt&&x(S.normalMap.channel),displacementMapUv:be&&x(S.displacementMap.channel),emissiveMapUv:Ct&&x(S.emissiveMap.channel),metalnessMapUv:Ht&&x(S.metalnessMap.channel),roughnessMapUv:Be&&x(S.roughnessMap.channel),anisotropyMapUv:tt&&x(S.anisotropyMap.channel),clearcoatMapUv:Ut&&x(S.clearcoatMap.channel),clearcoatNormalMapUv:ut&&x(S.clearcoatNormalMap.channel),clearcoatRoughnessMapUv:It&&x(S.clearcoatRoughnessMap.channel),iridescenceMapUv:At&&x(S.iridescenceMap.channel),iridescenceThicknessMapUv:ot&&x(S.iridescenceThicknessMap.channel),sheenColorMapUv:gt&&x(S.sheenColorMap.channel),sheenRoughnessMapUv:Bt&&x(S.sheenRoughnessMap.channel),specularMapUv:Ot&&x(S.specularMap.channel),specularColorMapUv:vt&&x(S.specularColorMap.channel),specularIntensityMapUv:Kt&&x(S.specularIntensityMap.channel),transmissionMapUv:B&&x(S.transmissionMap.channel),thicknessMapUv:dt&&x(S.thicknessMap.channel),alphaMapUv:Pt&&x(S.alphaMap.channel),vertexTangents:!!X.attributes.tangent&&(Nt||xe),vertexColors:S.vertexColors,vertexAlphas:S.vertexColors===!0&&!!X.attributes.color&&X.attributes.color.itemSize===4,pointsUvs:z.isPoints===!0&&!!X.attributes.uv&&(te||Pt),fog:!!W,useFog:S.fog===!0,fogExp2:!!W&&W.isFogExp2,flatShading:S.flatShading===!0&&S.wireframe===!1,sizeAttenuation:S.sizeAttenuation===!0,logarithmicDepthBuffer:u,reversedDepthBuffer:wt,skinning:z.isSkinnedMesh===!0,morphTargets:X.morphAttributes.position!==void 0,morphNormals:X.morphAttributes.normal!==void 0,morphColors:X.morphAttributes.color!==void 0,morphTargetsCount:xt,morphTextureStride:Mt,numDirLights:b.directional.length,numPointLights:b.point.length,numSpotLights:b.spot.length,numSpotLightMaps:b.spotLightMap.length,numRectAreaLights:b.rectArea.length,numHemiLights:b.hemi.length,numDirLightShadows:b.directionalShadowMap.length,numPointLightShadows:b.pointShadowMap.length,numSpotLightShadows:b.spotShadowMap.length,numSpotLightShadowsWithMaps:b.numSpotLightShadowsWithMaps,numLightProbes:b.numLightProbes,numClippingPlanes:o.numPlanes,numClipIntersection:o.numIntersection,dithering:S.dithering,shadowMapEnabled:i.shadowMap.enabled&&P.length>0,shadowMapType:i.shadowMap.type,toneMapping:ee,decodeVideoTexture:te&&S.map.isVideoTexture===!0&&fe.getTransfer(S.map.colorSpace)===Ee,decodeVideoTextureEmissive:Ct&&S.emissiveMap.isVideoTexture===!0&&fe.getTransfer(S.emissiveMap.colorSpace)===Ee,premultipliedAlpha:S.premultipliedAlpha,doubleSided:S.side===Vn,flipSided:S.side===Fn,useDepthPacking:S.depthPacking>=0,depthPacking:S.depthPacking||0,index0AttributeName:S.index0AttributeName,extensionClipCullDistance:Ft&&S.extensions.clipCullDistance===!0&&n.has("WEBGL_clip_cull_distance"),extensionMultiDraw:(Ft&&S.extensions.multiDraw===!0||yt)&&n.has("WEBGL_multi_draw"),rendererExtensionParallelShaderCompile:n.has("KHR_parallel_shader_compile"),customProgramCacheKey:S.customProgramCacheKey()};return Te.vertexUv1s=l.has(1),Te.vertexUv2s=l.has(2),Te.vertexUv3s=l.has(3),l.clear(),Te}function p(S){let b=[];if(S.shaderID?b.push(S.shaderID):(b.push(S.customVertexShaderID),b.push(S.customFragmentShaderID)),S.defines!==void 0)for(let P in S.defines)b.push(P),b.push(S.defines[P]);return S.isRawShaderMaterial===!1&&(w(b,S),E(b,S),b.push(i.outputColorSpace)),b.push(S.customProgramCacheKey),b.join()}function w(S,b){S.push(b.precision),S.push(b.outputColorSpace),S.push(b.envMapMode),S.push(b.envMapCubeUVHeight),S.push(b.mapUv),S.push(b.alphaMapUv),S.push(b.lightMapUv),S.push(b.aoMapUv),S.push(b.bumpMapUv),S.push(b.normalMapUv),S.push(b.displacementMapUv),S.push(b.emissiveMapUv),S.push(b.metalnessMapUv),S.push(b.roughnessMapUv),S.push(b.anisotropyMapUv),S.push(b.clearcoatMapUv),S.push(b.clearcoatNormalMapUv),S.push(b.clearcoatRoughnessMapUv),S.push(b.iridescenceMapUv),S.push(b.iridescenceThicknessMapUv),S.push(b.sheenColorMapUv),S.push(b.sheenRoughnessMapUv),S.push(b.specularMapUv),S.push(b.specularColorMapUv),S.push(b.specularIntensityMapUv),S.push(b.transmissionMapUv),S.push(b.thicknessMapUv),S.push(b.combine),S.push(b.fogExp2),S.push(b.sizeAttenuation),S.push(b.morphTargetsCount),S.push(b.morphAttributeCount),S.push(b.numDirLights),S.push(b.numPointLights),S.push(b.numSpotLights),S.push(b.numSpotLightMaps),S.push(b.numHemiLights),S.push(b.numRectAreaLights),S.push(b.numDirLightShadows),S.push(b.numPointLightShadows),S.push(b.numSpotLightShadows),S.push(b.numSpotLightShadowsWithMaps),S.push(b.numLightProbes),S.push(b.shadowMapType),S.push(b.toneMapping),S.push(b.numClippingPlanes),S.push(b.numClipIntersection),S.push(b.depthPacking)}function E(S,b){a.disableAll(),b.supportsVertexTextures&&a.enable(0),b.instancing&&a.enable(1),b.instancingColor&&a.enable(2),b.instancingMorph&&a.enable(3),b.matcap&&a.enable(4),b.envMap&&a.enable(5),b.normalMapObjectSpace&&a.enable(6),b.normalMapTangentSpace&&a.enable(7),b.clearcoat&&a.enable(8),b.iridescence&&a.enable(9),b.alphaTest&&a.enable(10),b.vertexColors&&a.enable(11),b.vertexAlphas&&a.enable(12),b.vertexUv1s&&a.enable(13),b.vertexUv2s&&a.enable(14),b.vertexUv3s&&a.enable(15),b.vertexTangents&&a.enable(16),b.anisotropy&&a.enable(17),b.alphaHash&&a.enable(18),b.batching&&a.enable(19),b.dispersion&&a.enable(20),b.batchingColor&&a.enable(21),b.gradientMap&&a.enable(22),S.push(a.mask),a.disableAll(),b.fog&&a.enable(0),b.useFog&&a.enable(1),b.flatShading&&a.enable(2),b.logarithmicDepthBuffer&&a.enable(3),b.reversedDepthBuffer&&a.enable(4),b.skinning&&a.enable(5),b.morphTargets&&a.enable(6),b.morphNormals&&a.enable(7),b.morphColors&&a.enable(8),b.premultipliedAlpha&&a.enable(9),b.shadowMapEnabled&&a.enable(10),b.doubleSided&&a.enable(11),b.flipSided&&a.enable(12),b.useDepthPacking&&a.enable(13),b.dithering&&a.enable(14),b.transmission&&a.enable(15),b.sheen&&a.enable(16),b.opaque&&a.enable(17),b.pointsUvs&&a.enable(18),b.decodeVideoTexture&&a.enable(19),b.decodeVideoTextureEmissive&&a.enable(20),b.alphaToCoverage&&a.enable(21),S.push(a.mask)}function v(S){let b=g[S.type],P;if(b){let O=Ui[b];P=cm.clone(O.uniforms)}else P=S.uniforms;return P}function C(S,b){let P;for(let O=0,z=h.length;O<z;O++){let W=h[O];if(W.cacheKey===b){P=W,++P.usedTimes;break}}return P===void 0&&(P=new Zb(i,b,S,r),h.push(P)),P}function A(S){if(--S.usedTimes===0){let b=h.indexOf(S);h[b]=h[h.length-1],h.pop(),S.destroy()}}function D(S){c.remove(S)}function U(){c.dispose()}return{getParameters:m,getProgramCacheKey:p,getUniforms:v,acquireProgram:C,releaseProgram:A,releaseShaderCache:D,programs:h,dispose:U}}function jb(){let i=new WeakMap;function t(o){return i.has(o)}function e(o){let a=i.get(o);return a===void 0&&(a={},i.set(o,a)),a}function n(o){i.delete(o)}function s(o,a,c){i.get(o)[a]=c}function r(){i=new WeakMap}return{has:t,get:e,remove:n,update:s,dispose:r}}function Qb(i,t){return i.groupOrder!==t.groupOrder?i.groupOrder-t.groupOrder:i.renderOrder!==t.renderOrder?i.renderOrder-t.renderOrder:i.material.id!==t.material.id?i.material.id-t.material.id:i.z!==t.z?i.z-t.z:i.id-t.id}function Im(i,t){return i.groupOrder!==t.groupOrder?i.groupOrder-t.groupOrder:i.renderOrder!==t.renderOrder?i.renderOrder-t.renderOrder:i.z!==t.z?t.z-i.z:i.id-t.id}function Lm(){let i=[],t=0,e=[],n=[],s=[];function r(){t=0,e.length=0,n.length=0,s.length=0}function o(u,d,f,g,x,m){let p=i[t];return p===void 0?(p={id:u.id,object:u,geometry:d,material:f,groupOrder:g,renderOrder:u.renderOrder,z:x,group:m},i[t]=p):(p.id=u.id,p.object=u,p.geometry=d,p.material=f,p.groupOrder=g,p.renderOrder=u.renderOrder,p.z=x,p.group=m),t++,p}function a(u,d,f,g,x,m){let p=o(u,d,f,g,x,m);f.transmission>0?n.push(p):f.transparent===!0?s.push(p):e.push(p)}function c(u,d,f,g,x,m){let p=o(u,d,f,g,x,m);f.transmission>0?n.unshift(p):f.transparent===!0?s.unshift(p):e.unshift(p)}function l(u,d){e.length>1&&e.sort(u||Qb),n.length>1&&n.sort(d||Im),s.length>1&&s.sort(d||Im)}function h(){for(let u=t,d=i.length;u<d;u++){let f=i[u];if(f.id===null)break;f.id=null,f.object=null,f.geometry=null,f.material=null,f.group=null}}return{opaque:e,transmissive:n,transparent:s,init:r,push:a,unshift:c,finish:h,sort:l}}function tS(){let i=new WeakMap;function t(n,s){let r=i.get(n),o;return r===void 0?(o=new Lm,i.set(n,[o])):s>=r.length?(o=new Lm,r.push(o)):o=r[s],o}function e(){i=new WeakMap}return{get:t,dispose:e}}function eS(){let i={};return{get:function(t){if(i[t.id]!==void 0)return i[t.id];let e;switch(t.type){case"DirectionalLight":e={direction:new H,color:new jt};break;case"SpotLight":e={position:new H,direction:new H,color:new jt,distance:0,coneCos:0,penumbraCos:0,decay:0};break;case"PointLight":e={position:new H,color:new jt,distance:0,decay:0};break;case"HemisphereLight":e={direction:new H,skyColor:new jt,groundColor:new jt};break;case"RectAreaLight":e={color:new jt,position:new H,halfWidth:new H,halfHeight:new H};break}return i[t.id]=e,e}}}function nS(){let i={};return{get:function(t){if(i[t.id]!==void 0)return i[t.id];let e;switch(t.type){case"DirectionalLight":e={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new Jt};break;case"SpotLight":e={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new Jt};break;case"PointLight":e={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new Jt,shadowCameraNear:1,shadowCameraFar:1e3};break}return i[t.id]=e,e}}}var iS=0;function sS(i,t){return(t.castShadow?2:0)-(i.castShadow?2:0)+(t.map?1:0)-(i.map?1:0)}function rS(i){let t=new eS,e=nS(),n={version:0,hash:{directionalLength:-1,pointLength:-1,spotLength:-1,rectAreaLength:-1,hemiLength:-1,numDirectionalShadows:-1,numPointShadows:-1,numSpotShadows:-1,numSpotMaps:-1,numLightProbes:-1},ambient:[0,0,0],probe:[],directional:[],directionalShadow:[],directionalShadowMap:[],directionalShadowMatrix:[],spot:[],spotLightMap:[],spotShadow:[],spotShadowMap:[],spotLightMatrix:[],rectArea:[],rectAreaLTC1:null,rectAreaLTC2:null,point:[],pointShadow:[],pointShadowMap:[],pointShadowMatrix:[],hemi:[],numSpotLightShadowsWithMaps:0,numLightProbes:0};for(let l=0;l<9;l++)n.probe.push(new H);let s=new H,r=new Re,o=new Re;function a(l){let h=0,u=0,d=0;for(let S=0;S<9;S++)n.probe[S].set(0,0,0);let f=0,g=0,x=0,m=0,p=0,w=0,E=0,v=0,C=0,A=0,D=0;l.sort(sS);for(let S=0,b=l.length;S<b;S++){let P=l[S],O=P.color,z=P.intensity,W=P.distance,X=P.shadow&&P.shadow.map?P.shadow.map.texture:null;if(P.isAmbientLight)h+=O.r*z,u+=O.g*z,d+=O.b*z;else if(P.isLightProbe){for(let Y=0;Y<9;Y++)n.probe[Y].addScaledVector(P.sh.coefficients[Y],z);D++}else if(P.isDirectionalLight){let Y=t.get(P);if(Y.color.copy(P.color).multiplyScalar(P.intensity),P.castShadow){let j=P.shadow,K=e.get(P);K.shadowIntensity=j.intensity,K.shadowBias=j.bias,K.shadowNormalBias=j.normalBias,K.shadowRadius=j.radius,K.shadowMapSize=j.mapSize,n.directionalShadow[f]=K,n.directionalShadowMap[f]=X,n.directionalShadowMatrix[f]=P.shadow.matrix,w++}n.directional[f]=Y,f++}else if(P.isSpotLight){let Y=t.get(P);Y.position.setFromMatrixPosition(P.matrixWorld),Y.color.copy(O).multiplyScalar(z),Y.distance=W,Y.coneCos=Math.cos(P.angle),Y.penumbraCos=Math.cos(P.angle*(1-P.penumbra)),Y.decay=P.decay,n.spot[x]=Y;let j=P.shadow;if(P.map&&(n.spotLightMap[C]=P.map,C++,j.updateMatrices(P),P.castShadow&&A++),n.spotLightMatrix[x]=j.matrix,P.castShadow){let K=e.get(P);K.shadowIntensity=j.intensity,K.shadowBias=j.bias,K.shadowNormalBias=j.normalBias,K.shadowRadius=j.radius,K.shadowMapSize=j.mapSize,n.spotShadow[x]=K,n.spotShadowMap[x]=X,v++}x++}else if(P.isRectAreaLight){let Y=t.get(P);Y.color.copy(O).multiplyScalar(z),Y.halfWidth.set(P.width*.5,0,0),Y.halfHeight.set(0,P.height*.5,0),n.rectArea[m]=Y,m++}else if(P.isPointLight){let Y=t.get(P);if(Y.color.copy(P.color).multiplyScalar(P.intensity),Y.distance=P.distance,Y.decay=P.decay,P.castShadow){let j=P.shadow,K=e.get(P);K.shadowIntensity=j.intensity,K.shadowBias=j.bias,K.shadowNormalBias=j.normalBias,K.shadowRadius=j.radius,K.shadowMapSize=j.mapSize,K.shadowCameraNear=j.camera.near,K.shadowCameraFar=j.camera.far,n.pointShadow[g]=K,n.pointShadowMap[g]=X,n.pointShadowMatrix[g]=P.shadow.matrix,E++}n.point[g]=Y,g++}else if(P.isHemisphereLight){let Y=t.get(P);Y.skyColor.copy(P.color).multiplyScalar(z),Y.groundColor.copy(P.groundColor).multiplyScalar(z),n.hemi[p]=Y,p++}}m>0&&(i.has("OES_texture_float_linear")===!0?(n.rectAreaLTC1=St.LTC_FLOAT_1,n.rectAreaLTC2=St.LTC_FLOAT_2):(n.rectAreaLTC1=St.LTC_HALF_1,n.rectAreaLTC2=St.LTC_HALF_2)),n.ambient[0]=h,n.ambient[1]=u,n.ambient[2]=d;let U=n.hash;(U.directionalLength!==f||U.pointLength!==g||U.spotLength!==x||U.rectAreaLength!==m||U.hemiLength!==p||U.numDirectionalShadows!==w||U.numPointShadows!==E||U.numSpotShadows!==v||U.numSpotMaps!==C||U.numLightProbes!==D)&&(n.directional.length=f,n.spot.length=x,n.rectArea.length=m,n.point.length=g,n.hemi.length=p,n.directionalShadow.length=w,n.directionalShadowMap.length=w,n.pointShadow.length=E,n.pointShadowMap.length=E,n.spotShadow.length=v,n.spotShadowMap.length=v,n.directionalShadowMatrix.length=w,n.pointShadowMatrix.length=E,n.spotLightMatrix.length=v+C-A,n.spotLightMap.length=C,n.numSpotLightShadowsWithMaps=A,n.numLightProbes=D,U.directionalLength=f,U.pointLength=g,U.spotLength=x,U.rectAreaLength=m,U.hemiLength=p,U.numDirectionalShadows=w,U.numPointShadows=E,U.numSpotShadows=v,U.numSpotMaps=C,U.numLightProbes=D,n.version=iS++)}function c(l,h){let u=0,d=0,f=0,g=0,x=0,m=h.matrixWorldInverse;for(let p=0,w=l.length;p<w;p++){let E=l[p];if(E.isDirectionalLight){let v=n.directional[u];v.direction.setFromMatrixPosition(E.matrixWorld),s.setFromMatrixPosition(E.target.matrixWorld),v.direction.sub(s),v.direction.transformDirection(m),u++}else if(E.isSpotLight){let v=n.spot[f];v.position.setFromMatrixPosition(E.matrixWorld),v.position.applyMatrix4(m),v.direction.setFromMatrixPosition(E.matrixWorld),s.setFromMatrixPosition(E.target.matrixWorld),v.direction.sub(s),v.direction.transformDirection(m),f++}else if(E.isRectAreaLight){let v=n.rectArea[g];v.position.setFromMatrixPosition(E.matrixWorld),v.position.applyMatrix4(m),o.identity(),r.copy(E.matrixWorld),r.premultiply(m),o.extractRotation(r),v.halfWidth.set(E.width*.5,0,0),v.halfHeight.set(0,E.height*.5,0),v.halfWidth.applyMatrix4(o),v.halfHeight.applyMatrix4(o),g++}else if(E.isPointLight){let v=n.point[d];v.position.setFromMatrixPosition(E.matrixWorld),v.position.applyMatrix4(m),d++}else if(E.isHemisphereLight){let v=n.hemi[x];v.direction.setFromMatrixPosition(E.matrixWorld),v.direction.transformDirection(m),x++}}}return{setup:a,setupView:c,state:n}}function Dm(i){let t=new rS(i),e=[],n=[];function s(h){l.camera=h,e.length=0,n.length=0}function r(h){e.push(h)}function o(h){n.push(h)}function a(){t.setup(e)}function c(h){t.setupView(e,h)}let l={lightsArray:e,shadowsArray:n,camera:null,lights:t,transmissionRenderTarget:{}};return{init:s,state:l,setupLights:a,setupLightsView:c,pushLight:r,pushShadow:o}}function oS(i){let t=new WeakMap;function e(s,r=0){let o=t.get(s),a;return o===void 0?(a=new Dm(i),t.set(s,[a])):r>=o.length?(a=new Dm(i),o.push(a)):a=o[r],a}function n(){t=new WeakMap}return{get:e,dispose:n}}var aS=`void main() {
	gl_Position = vec4( position, 1.0 );
}`,lS=`uniform sampler2D shadow_pass;
uniform vec2 resolution;
uniform float radius;
#include <packing>
void main() {
	const float samples = float( VSM_SAMPLES );
	float mean = 0.0;
	float squared_mean = 0.0;
	float uvStride = samples <= 1.0 ? 0.0 : 2.0 / ( samples - 1.0 );
	float uvStart = samples <= 1.0 ? 0.0 : - 1.0;
	for ( float i = 0.0; i < samples; i ++ ) {
		float uvOffset = uvStart + i * uvStride;
		#ifdef HORIZONTAL_PASS
			vec2 distribution = unpackRGBATo2Half( texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( uvOffset, 0.0 ) * radius ) / resolution ) );
			mean += distribution.x;
			squared_mean += distribution.y * distribution.y + distribution.x * distribution.x;
		#else
			float depth = unpackRGBAToDepth( texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( 0.0, uvOffset ) * radius ) / resolution ) );
			mean += depth;
			squared_mean += depth * depth;
		#endif
	}
	mean = mean / samples;
	squared_mean = squared_mean / samples;
	float std_dev = sqrt( squared_mean - mean * mean );
	gl_FragColor = pack2HalfToRGBA( vec2( mean, std_dev ) );
}`;function cS(i,t,e){let n=new Vo,s=new Jt,r=new Jt,o=new Ze,a=new al({depthPacking:Jp}),c=new ll,l={},h=e.maxTextureSize,u={[Zi]:Fn,[Fn]:Zi,[Vn]:Vn},d=new on({defines:{VSM_SAMPLES:8},uniforms:{shadow_pass:{value:null},resolution:{value:new Jt},radius:{value:4}},vertexShader:aS,fragmentShader:lS}),f=d.clone();f.defines.HORIZONTAL_PASS=1;let g=new Qe;g.setAttribute("position",new Oe(new Float32Array([-1,-1,.5,3,-1,.5,-1,3,.5]),3));let x=new tn(g,d),m=this;this.enabled=!1,this.autoUpdate=!0,this.needsUpdate=!1,this.type=Yh;let p=this.type;this.render=function(A,D,U){if(m.enabled===!1||m.autoUpdate===!1&&m.needsUpdate===!1||A.length===0)return;let S=i.getRenderTarget(),b=i.getActiveCubeFace(),P=i.getActiveMipmapLevel(),O=i.state;O.setBlending(Ki),O.buffers.depth.getReversed()===!0?O.buffers.color.setClear(0,0,0,0):O.buffers.color.setClear(1,1,1,1),O.buffers.depth.setTest(!0),O.setScissorTest(!1);let z=p!==Di&&this.type===Di,W=p===Di&&this.type!==Di;for(let X=0,Y=A.length;X<Y;X++){let j=A[X],K=j.shadow;if(K===void 0){console.warn("THREE.WebGLShadowMap:",j,"has no shadow.");continue}if(K.autoUpdate===!1&&K.needsUpdate===!1)continue;s.copy(K.mapSize);let at=K.getFrameExtents();if(s.multiply(at),r.copy(K.mapSize),(s.x>h||s.y>h)&&(s.x>h&&(r.x=Math.floor(h/at.x),s.x=r.x*at.x,K.mapSize.x=r.x),s.y>h&&(r.y=Math.floor(h/at.y),s.y=r.y*at.y,K.mapSize.y=r.y)),K.map===null||z===!0||W===!0){let xt=this.type!==Di?{minFilter:kn,magFilter:kn}:{};K.map!==null&&K.map.dispose(),K.map=new Ii(s.x,s.y,xt),K.map.texture.name=j.name+".shadowMap",K.camera.updateProjectionMatrix()}i.setRenderTarget(K.map),i.clear();let lt=K.getViewportCount();for(let xt=0;xt<lt;xt++){let Mt=K.getViewport(xt);o.set(r.x*Mt.x,r.y*Mt.y,r.x*Mt.z,r.y*Mt.w),O.viewport(o),K.updateMatrices(j,xt),n=K.getFrustum(),v(D,U,K.camera,j,this.type)}K.isPointLightShadow!==!0&&this.type===Di&&w(K,U),K.needsUpdate=!1}p=this.type,m.needsUpdate=!1,i.setRenderTarget(S,b,P)};function w(A,D){let U=t.update(x);d.defines.VSM_SAMPLES!==A.blurSamples&&(d.defines.VSM_SAMPLES=A.blurSamples,f.defines.VSM_SAMPLES=A.blurSamples,d.needsUpdate=!0,f.needsUpdate=!0),A.mapPass===null&&(A.mapPass=new Ii(s.x,s.y)),d.uniforms.shadow_pass.value=A.map.texture,d.uniforms.resolution.value=A.mapSize,d.uniforms.radius.value=A.radius,i.setRenderTarget(A.mapPass),i.clear(),i.renderBufferDirect(D,null,U,d,x,null),f.uniforms.shadow_pass.value=A.mapPass.texture,f.uniforms.resolution.value=A.mapSize,f.uniforms.radius.value=A.radius,i.setRenderTarget(A.map),i.clear(),i.renderBufferDirect(D,null,U,f,x,null)}function E(A,D,U,S){let b=null,P=U.isPointLight===!0?A.customDistanceMaterial:A.customDepthMaterial;if(P!==void 0)b=P;else if(b=U.isPointLight===!0?c:a,i.localClippingEnabled&&D.clipShadows===!0&&Array.isArray(D.clippingPlanes)&&D.clippingPlanes.length!==0||D.displacementMap&&D.displacementScale!==0||D.alphaMap&&D.alphaTest>0||D.map&&D.alphaTest>0||D.alphaToCoverage===!0){let O=b.uuid,z=D.uuid,W=l[O];W===void 0&&(W={},l[O]=W);let X=W[z];X===void 0&&(X=b.clone(),W[z]=X,D.addEventListener("dispose",C)),b=X}if(b.visible=D.visible,b.wireframe=D.wireframe,S===Di?b.side=D.shadowSide!==null?D.shadowSide:D.side:b.side=D.shadowSide!==null?D.shadowSide:u[D.side],b.alphaMap=D.alphaMap,b.alphaTest=D.alphaToCoverage===!0?.5:D.alphaTest,b.map=D.map,b.clipShadows=D.clipShadows,b.clippingPlanes=D.clippingPlanes,b.clipIntersection=D.clipIntersection,b.displacementMap=D.displacementMap,b.displacementScale=D.displacementScale,b.displacementBias=D.displacementBias,b.wireframeLinewidth=D.wireframeLinewidth,b.linewidth=D.linewidth,U.isPointLight===!0&&b.isMeshDistanceMaterial===!0){let O=i.properties.get(b);O.light=U}return b}function v(A,D,U,S,b){if(A.visible===!1)return;if(A.layers.test(D.layers)&&(A.isMesh||A.isLine||A.isPoints)&&(A.castShadow||A.receiveShadow&&b===Di)&&(!A.frustumCulled||n.intersectsObject(A))){A.modelViewMatrix.multiplyMatrices(U.matrixWorldInverse,A.matrixWorld);let z=t.update(A),W=A.material;if(Array.isArray(W)){let X=z.groups;for(let Y=0,j=X.length;Y<j;Y++){let K=X[Y],at=W[K.materialIndex];if(at&&at.visible){let lt=E(A,at,S,b);A.onBeforeShadow(i,A,D,U,z,lt,K),i.renderBufferDirect(U,null,z,lt,A,K),A.onAfterShadow(i,A,D,U,z,lt,K)}}}else if(W.visible){let X=E(A,W,S,b);A.onBeforeShadow(i,A,D,U,z,X,null),i.renderBufferDirect(U,null,z,X,A,null),A.onAfterShadow(i,A,D,U,z,X,null)}}let O=A.children;for(let z=0,W=O.length;z<W;z++)v(O[z],D,U,S,b)}function C(A){A.target.removeEventListener("dispose",C);for(let U in l){let S=l[U],b=A.target.uuid;b in S&&(S[b].dispose(),delete S[b])}}}var hS={[vl]:Ml,[bl]:El,[Sl]:Tl,[Ys]:wl,[Ml]:vl,[El]:bl,[Tl]:Sl,[wl]:Ys};function uS(i,t){function e(){let B=!1,dt=new Ze,pt=null,Pt=new Ze(0,0,0,0);return{setMask:function(ht){pt!==ht&&!B&&(i.colorMask(ht,ht,ht,ht),pt=ht)},setLocked:function(ht){B=ht},setClear:function(ht,rt,Ft,ee,Te){Te===!0&&(ht*=ee,rt*=ee,Ft*=ee),dt.set(ht,rt,Ft,ee),Pt.equals(dt)===!1&&(i.clearColor(ht,rt,Ft,ee),Pt.copy(dt))},reset:function(){B=!1,pt=null,Pt.set(-1,0,0,0)}}}function n(){let B=!1,dt=!1,pt=null,Pt=null,ht=null;return{setReversed:function(rt){if(dt!==rt){let Ft=t.get("EXT_clip_control");rt?Ft.clipControlEXT(Ft.LOWER_LEFT_EXT,Ft.ZERO_TO_ONE_EXT):Ft.clipControlEXT(Ft.LOWER_LEFT_EXT,Ft.NEGATIVE_ONE_TO_ONE_EXT),dt=rt;let ee=ht;ht=null,this.setClear(ee)}},getReversed:function(){return dt},setTest:function(rt){rt?et(i.DEPTH_TEST):wt(i.DEPTH_TEST)},setMask:function(rt){pt!==rt&&!B&&(i.depthMask(rt),pt=rt)},setFunc:function(rt){if(dt&&(rt=hS[rt]),Pt!==rt){switch(rt){case vl:i.depthFunc(i.NEVER);break;case Ml:i.depthFunc(i.ALWAYS);break;case bl:i.depthFunc(i.LESS);break;case Ys:i.depthFunc(i.LEQUAL);break;case Sl:i.depthFunc(i.EQUAL);break;case wl:i.depthFunc(i.GEQUAL);break;case El:i.depthFunc(i.GREATER);break;case Tl:i.depthFunc(i.NOTEQUAL);break;default:i.depthFunc(i.LEQUAL)}Pt=rt}},setLocked:function(rt){B=rt},setClear:function(rt){ht!==rt&&(dt&&(rt=1-rt),i.clearDepth(rt),ht=rt)},reset:function(){B=!1,pt=null,Pt=null,ht=null,dt=!1}}}function s(){let B=!1,dt=null,pt=null,Pt=null,ht=null,rt=null,Ft=null,ee=null,Te=null;return{setTest:function(pe){B||(pe?et(i.STENCIL_TEST):wt(i.STENCIL_TEST))},setMask:function(pe){dt!==pe&&!B&&(i.stencilMask(pe),dt=pe)},setFunc:function(pe,xn,Pe){(pt!==pe||Pt!==xn||ht!==Pe)&&(i.stencilFunc(pe,xn,Pe),pt=pe,Pt=xn,ht=Pe)},setOp:function(pe,xn,Pe){(rt!==pe||Ft!==xn||ee!==Pe)&&(i.stencilOp(pe,xn,Pe),rt=pe,Ft=xn,ee=Pe)},setLocked:function(pe){B=pe},setClear:function(pe){Te!==pe&&(i.clearStencil(pe),Te=pe)},reset:function(){B=!1,dt=null,pt=null,Pt=null,ht=null,rt=null,Ft=null,ee=null,Te=null}}}let r=new e,o=new n,a=new s,c=new WeakMap,l=new WeakMap,h={},u={},d=new WeakMap,f=[],g=null,x=!1,m=null,p=null,w=null,E=null,v=null,C=null,A=null,D=new jt(0,0,0),U=0,S=!1,b=null,P=null,O=null,z=null,W=null,X=i.getParameter(i.MAX_COMBINED_TEXTURE_IMAGE_UNITS),Y=!1,j=0,K=i.getParameter(i.VERSION);K.indexOf("WebGL")!==-1?(j=parseFloat(/^WebGL (\d)/.exec(K)[1]),Y=j>=1):K.indexOf("OpenGL ES")!==-1&&(j=parseFloat(/^OpenGL ES (\d)/.exec(K)[1]),Y=j>=2);let at=null,lt={},xt=i.getParameter(i.SCISSOR_BOX),Mt=i.getParameter(i.VIEWPORT),_t=new Ze().fromArray(xt),ie=new Ze().fromArray(Mt);function Qt(B,dt,pt,Pt){let ht=new Uint8Array(4),rt=i.createTexture();i.bindTexture(B,rt),i.texParameteri(B,i.TEXTURE_MIN_FILTER,i.NEAREST),i.texParameteri(B,i.TEXTURE_MAG_FILTER,i.NEAREST);for(let Ft=0;Ft<pt;Ft++)B===i.TEXTURE_3D||B===i.TEXTURE_2D_ARRAY?i.texImage3D(dt,0,i.RGBA,1,1,Pt,0,i.RGBA,i.UNSIGNED_BYTE,ht):i.texImage2D(dt+Ft,0,i.RGBA,1,1,0,i.RGBA,i.UNSIGNED_BYTE,ht);return rt}let Q={};Q[i.TEXTURE_2D]=Qt(i.TEXTURE_2D,i.TEXTURE_2D,1),Q[i.TEXTURE_CUBE_MAP]=Qt(i.TEXTURE_CUBE_MAP,i.TEXTURE_CUBE_MAP_POSITIVE_X,6),Q[i.TEXTURE_2D_ARRAY]=Qt(i.TEXTURE_2D_ARRAY,i.TEXTURE_2D_ARRAY,1,1),Q[i.TEXTURE_3D]=Qt(i.TEXTURE_3D,i.TEXTURE_3D,1,1),r.setClear(0,0,0,1),o.setClear(1),a.setClear(0),et(i.DEPTH_TEST),o.setFunc(Ys),Gt(!1),Nt(qh),et(i.CULL_FACE),de(Ki);function et(B){h[B]!==!0&&(i.enable(B),h[B]=!0)}function wt(B){h[B]!==!1&&(i.disable(B),h[B]=!1)}function kt(B,dt){return u[B]!==dt?(i.bindFramebuffer(B,dt),u[B]=dt,B===i.DRAW_FRAMEBUFFER&&(u[i.FRAMEBUFFER]=dt),B===i.FRAMEBUFFER&&(u[i.DRAW_FRAMEBUFFER]=dt),!0):!1}function yt(B,dt){let pt=f,Pt=!1;if(B){pt=d.get(dt),pt===void 0&&(pt=[],d.set(dt,pt));let ht=B.textures;if(pt.length!==ht.length||pt[0]!==i.COLOR_ATTACHMENT0){for(let rt=0,Ft=ht.length;rt<Ft;rt++)pt[rt]=i.COLOR_ATTACHMENT0+rt;pt.length=ht.length,Pt=!0}}else pt[0]!==i.BACK&&(pt[0]=i.BACK,Pt=!0);Pt&&i.drawBuffers(pt)}function te(B){return g!==B?(i.useProgram(B),g=B,!0):!1}let De={[_s]:i.FUNC_ADD,[bp]:i.FUNC_SUBTRACT,[Sp]:i.FUNC_REVERSE_SUBTRACT};De[wp]=i.MIN,De[Ep]=i.MAX;let N={[Tp]:i.ZERO,[Ap]:i.ONE,[Rp]:i.SRC_COLOR,[Za]:i.SRC_ALPHA,[Np]:i.SRC_ALPHA_SATURATE,[Lp]:i.DST_COLOR,[Pp]:i.DST_ALPHA,[Cp]:i.ONE_MINUS_SRC_COLOR,[Ja]:i.ONE_MINUS_SRC_ALPHA,[Dp]:i.ONE_MINUS_DST_COLOR,[Ip]:i.ONE_MINUS_DST_ALPHA,[Up]:i.CONSTANT_COLOR,[Fp]:i.ONE_MINUS_CONSTANT_COLOR,[Op]:i.CONSTANT_ALPHA,[Bp]:i.ONE_MINUS_CONSTANT_ALPHA};function de(B,dt,pt,Pt,ht,rt,Ft,ee,Te,pe){if(B===Ki){x===!0&&(wt(i.BLEND),x=!1);return}if(x===!1&&(et(i.BLEND),x=!0),B!==Mp){if(B!==m||pe!==S){if((p!==_s||v!==_s)&&(i.blendEquation(i.FUNC_ADD),p=_s,v=_s),pe)switch(B){case qs:i.blendFuncSeparate(i.ONE,i.ONE_MINUS_SRC_ALPHA,i.ONE,i.ONE_MINUS_SRC_ALPHA);break;case $h:i.blendFunc(i.ONE,i.ONE);break;case Zh:i.blendFuncSeparate(i.ZERO,i.ONE_MINUS_SRC_COLOR,i.ZERO,i.ONE);break;case Jh:i.blendFuncSeparate(i.DST_COLOR,i.ONE_MINUS_SRC_ALPHA,i.ZERO,i.ONE);break;default:console.error("THREE.WebGLState: Invalid blending: ",B);break}else switch(B){case qs:i.blendFuncSeparate(i.SRC_ALPHA,i.ONE_MINUS_SRC_ALPHA,i.ONE,i.ONE_MINUS_SRC_ALPHA);break;case $h:i.blendFuncSeparate(i.SRC_ALPHA,i.ONE,i.ONE,i.ONE);break;case Zh:console.error("THREE.WebGLState: SubtractiveBlending requires material.premultipliedAlpha = true");break;case Jh:console.error("THREE.WebGLState: MultiplyBlending requires material.premultipliedAlpha = true");break;default:console.error("THREE.WebGLState: Invalid blending: ",B);break}w=null,E=null,C=null,A=null,D.set(0,0,0),U=0,m=B,S=pe}return}ht=ht||dt,rt=rt||pt,Ft=Ft||Pt,(dt!==p||ht!==v)&&(i.blendEquationSeparate(De[dt],De[ht]),p=dt,v=ht),(pt!==w||Pt!==E||rt!==C||Ft!==A)&&(i.blendFuncSeparate(N[pt],N[Pt],N[rt],N[Ft]),w=pt,E=Pt,C=rt,A=Ft),(ee.equals(D)===!1||Te!==U)&&(i.blendColor(ee.r,ee.g,ee.b,Te),D.copy(ee),U=Te),m=B,S=!1}function $t(B,dt){B.side===Vn?wt(i.CULL_FACE):et(i.CULL_FACE);let pt=B.side===Fn;dt&&(pt=!pt),Gt(pt),B.blending===qs&&B.transparent===!1?de(Ki):de(B.blending,B.blendEquation,B.blendSrc,B.blendDst,B.blendEquationAlpha,B.blendSrcAlpha,B.blendDstAlpha,B.blendColor,B.blendAlpha,B.premultipliedAlpha),o.setFunc(B.depthFunc),o.setTest(B.depthTest),o.setMask(B.depthWrite),r.setMask(B.colorWrite);let Pt=B.stencilWrite;a.setTest(Pt),Pt&&(a.setMask(B.stencilWriteMask),a.setFunc(B.stencilFunc,B.stencilRef,B.stencilFuncMask),a.setOp(B.stencilFail,B.stencilZFail,B.stencilZPass)),Ct(B.polygonOffset,B.polygonOffsetFactor,B.polygonOffsetUnits),B.alphaToCoverage===!0?et(i.SAMPLE_ALPHA_TO_COVERAGE):wt(i.SAMPLE_ALPHA_TO_COVERAGE)}function Gt(B){b!==B&&(B?i.frontFace(i.CW):i.frontFace(i.CCW),b=B)}function Nt(B){B!==xp?(et(i.CULL_FACE),B!==P&&(B===qh?i.cullFace(i.BACK):B===yp?i.cullFace(i.FRONT):i.cullFace(i.FRONT_AND_BACK))):wt(i.CULL_FACE),P=B}function be(B){B!==O&&(Y&&i.lineWidth(B),O=B)}function Ct(B,dt,pt){B?(et(i.POLYGON_OFFSET_FILL),(z!==dt||W!==pt)&&(i.polygonOffset(dt,pt),z=dt,W=pt)):wt(i.POLYGON_OFFSET_FILL)}function Ht(B){B?et(i.SCISSOR_TEST):wt(i.SCISSOR_TEST)}function Be(B){B===void 0&&(B=i.TEXTURE0+X-1),at!==B&&(i.activeTexture(B),at=B)}function xe(B,dt,pt){pt===void 0&&(at===null?pt=i.TEXTURE0+X-1:pt=at);let Pt=lt[pt];Pt===void 0&&(Pt={type:void 0,texture:void 0},lt[pt]=Pt),(Pt.type!==B||Pt.texture!==dt)&&(at!==pt&&(i.activeTexture(pt),at=pt),i.bindTexture(B,dt||Q[B]),Pt.type=B,Pt.texture=dt)}function I(){let B=lt[at];B!==void 0&&B.type!==void 0&&(i.bindTexture(B.type,null),B.type=void 0,B.texture=void 0)}function y(){try{i.compressedTexImage2D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function F(){try{i.compressedTexImage3D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function Z(){try{i.texSubImage2D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function nt(){try{i.texSubImage3D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function tt(){try{i.compressedTexSubImage2D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function Ut(){try{i.compressedTexSubImage3D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function ut(){try{i.texStorage2D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function It(){try{i.texStorage3D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function At(){try{i.texImage2D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function ot(){try{i.texImage3D(...arguments)}catch(B){console.error("THREE.WebGLState:",B)}}function gt(B){_t.equals(B)===!1&&(i.scissor(B.x,B.y,B.z,B.w),_t.copy(B))}function Bt(B){ie.equals(B)===!1&&(i.viewport(B.x,B.y,B.z,B.w),ie.copy(B))}function Ot(B,dt){let pt=l.get(dt);pt===void 0&&(pt=new WeakMap,l.set(dt,pt));let Pt=pt.get(B);Pt===void 0&&(Pt=i.getUniformBlockIndex(dt,B.name),pt.set(B,Pt))}function vt(B,dt){let Pt=l.get(dt).get(B);c.get(dt)!==Pt&&(i.uniformBlockBinding(dt,Pt,B.__bindingPointIndex),c.set(dt,Pt))}function Kt(){i.disable(i.BLEND),i.disable(i.CULL_FACE),i.disable(i.DEPTH_TEST),i.disable(i.POLYGON_OFFSET_FILL),i.disable(i.SCISSOR_TEST),i.disable(i.STENCIL_TEST),i.disable(i.SAMPLE_ALPHA_TO_COVERAGE),i.blendEquation(i.FUNC_ADD),i.blendFunc(i.ONE,i.ZERO),i.blendFuncSeparate(i.ONE,i.ZERO,i.ONE,i.ZERO),i.blendColor(0,0,0,0),i.colorMask(!0,!0,!0,!0),i.clearColor(0,0,0,0),i.depthMask(!0),i.depthFunc(i.LESS),o.setReversed(!1),i.clearDepth(1),i.stencilMask(4294967295),i.stencilFunc(i.ALWAYS,0,4294967295),i.stencilOp(i.KEEP,i.KEEP,i.KEEP),i.clearStencil(0),i.cullFace(i.BACK),i.frontFace(i.CCW),i.polygonOffset(0,0),i.activeTexture(i.TEXTURE0),i.bindFramebuffer(i.FRAMEBUFFER,null),i.bindFramebuffer(i.DRAW_FRAMEBUFFER,null),i.bindFramebuffer(i.READ_FRAMEBUFFER,null),i.useProgram(null),i.lineWidth(1),i.scissor(0,0,i.canvas.width,i.canvas.height),i.viewport(0,0,i.canvas.width,i.canvas.height),h={},at=null,lt={},u={},d=new WeakMap,f=[],g=null,x=!1,m=null,p=null,w=null,E=null,v=null,C=null,A=null,D=new jt(0,0,0),U=0,S=!1,b=null,P=null,O=null,z=null,W=null,_t.set(0,0,i.canvas.width,i.canvas.height),ie.set(0,0,i.canvas.width,i.canvas.height),r.reset(),o.reset(),a.reset()}return{buffers:{color:r,depth:o,stencil:a},enable:et,disable:wt,bindFramebuffer:kt,drawBuffers:yt,useProgram:te,setBlending:de,setMaterial:$t,setFlipSided:Gt,setCullFace:Nt,setLineWidth:be,setPolygonOffset:Ct,setScissorTest:Ht,activeTexture:Be,bindTexture:xe,unbindTexture:I,compressedTexImage2D:y,compressedTexImage3D:F,texImage2D:At,texImage3D:ot,updateUBOMapping:Ot,uniformBlockBinding:vt,texStorage2D:ut,texStorage3D:It,texSubImage2D:Z,texSubImage3D:nt,compressedTexSubImage2D:tt,compressedTexSubImage3D:Ut,scissor:gt,viewport:Bt,reset:Kt}}function dS(i,t,e,n,s,r,o){let a=t.has("WEBGL_multisampled_render_to_texture")?t.get("WEBGL_multisampled_render_to_texture"):null,c=typeof navigator>"u"?!1:/OculusBrowser/g.test(navigator.userAgent),l=new Jt,h=new WeakMap,u,d=new WeakMap,f=!1;try{f=typeof OffscreenCanvas<"u"&&new OffscreenCanvas(1,1).getContext("2d")!==null}catch{}function g(I,y){return f?new OffscreenCanvas(I,y):Do("canvas")}function x(I,y,F){let Z=1,nt=xe(I);if((nt.width>F||nt.height>F)&&(Z=F/Math.max(nt.width,nt.height)),Z<1)if(typeof HTMLImageElement<"u"&&I instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&I instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&I instanceof ImageBitmap||typeof VideoFrame<"u"&&I instanceof VideoFrame){let tt=Math.floor(Z*nt.width),Ut=Math.floor(Z*nt.height);u===void 0&&(u=g(tt,Ut));let ut=y?g(tt,Ut):u;return ut.width=tt,ut.height=Ut,ut.getContext("2d").drawImage(I,0,0,tt,Ut),console.warn("THREE.WebGLRenderer: Texture has been resized from ("+nt.width+"x"+nt.height+") to ("+tt+"x"+Ut+")."),ut}else return"data"in I&&console.warn("THREE.WebGLRenderer: Image in DataTexture is too big ("+nt.width+"x"+nt.height+")."),I;return I}function m(I){return I.generateMipmaps}function p(I){i.generateMipmap(I)}function w(I){return I.isWebGLCubeRenderTarget?i.TEXTURE_CUBE_MAP:I.isWebGL3DRenderTarget?i.TEXTURE_3D:I.isWebGLArrayRenderTarget||I.isCompressedArrayTexture?i.TEXTURE_2D_ARRAY:i.TEXTURE_2D}function E(I,y,F,Z,nt=!1){if(I!==null){if(i[I]!==void 0)return i[I];console.warn("THREE.WebGLRenderer: Attempt to use non-existing WebGL internal format '"+I+"'")}let tt=y;if(y===i.RED&&(F===i.FLOAT&&(tt=i.R32F),F===i.HALF_FLOAT&&(tt=i.R16F),F===i.UNSIGNED_BYTE&&(tt=i.R8)),y===i.RED_INTEGER&&(F===i.UNSIGNED_BYTE&&(tt=i.R8UI),F===i.UNSIGNED_SHORT&&(tt=i.R16UI),F===i.UNSIGNED_INT&&(tt=i.R32UI),F===i.BYTE&&(tt=i.R8I),F===i.SHORT&&(tt=i.R16I),F===i.INT&&(tt=i.R32I)),y===i.RG&&(F===i.FLOAT&&(tt=i.RG32F),F===i.HALF_FLOAT&&(tt=i.RG16F),F===i.UNSIGNED_BYTE&&(tt=i.RG8)),y===i.RG_INTEGER&&(F===i.UNSIGNED_BYTE&&(tt=i.RG8UI),F===i.UNSIGNED_SHORT&&(tt=i.RG16UI),F===i.UNSIGNED_INT&&(tt=i.RG32UI),F===i.BYTE&&(tt=i.RG8I),F===i.SHORT&&(tt=i.RG16I),F===i.INT&&(tt=i.RG32I)),y===i.RGB_INTEGER&&(F===i.UNSIGNED_BYTE&&(tt=i.RGB8UI),F===i.UNSIGNED_SHORT&&(tt=i.RGB16UI),F===i.UNSIGNED_INT&&(tt=i.RGB32UI),F===i.BYTE&&(tt=i.RGB8I),F===i.SHORT&&(tt=i.RGB16I),F===i.INT&&(tt=i.RGB32I)),y===i.RGBA_INTEGER&&(F===i.UNSIGNED_BYTE&&(tt=i.RGBA8UI),F===i.UNSIGNED_SHORT&&(tt=i.RGBA16UI),F===i.UNSIGNED_INT&&(tt=i.RGBA32UI),F===i.BYTE&&(tt=i.RGBA8I),F===i.SHORT&&(tt=i.RGBA16I),F===i.INT&&(tt=i.RGBA32I)),y===i.RGB&&(F===i.UNSIGNED_INT_5_9_9_9_REV&&(tt=i.RGB9_E5),F===i.UNSIGNED_INT_10F_11F_11F_REV&&(tt=i.R11F_G11F_B10F)),y===i.RGBA){let Ut=nt?Io:fe.getTransfer(Z);F===i.FLOAT&&(tt=i.RGBA32F),F===i.HALF_FLOAT&&(tt=i.RGBA16F),F===i.UNSIGNED_BYTE&&(tt=Ut===Ee?i.SRGB8_ALPHA8:i.RGBA8),F===i.UNSIGNED_SHORT_4_4_4_4&&(tt=i.RGBA4),F===i.UNSIGNED_SHORT_5_5_5_1&&(tt=i.RGB5_A1)}return(tt===i.R16F||tt===i.R32F||tt===i.RG16F||tt===i.RG32F||tt===i.RGBA16F||tt===i.RGBA32F)&&t.get("EXT_color_buffer_float"),tt}function v(I,y){let F;return I?y===null||y===As||y===Kr?F=i.DEPTH24_STENCIL8:y===bi?F=i.DEPTH32F_STENCIL8:y===Zr&&(F=i.DEPTH24_STENCIL8,console.warn("DepthTexture: 16 bit depth attachment is not supported with stencil. Using 24-bit attachment.")):y===null||y===As||y===Kr?F=i.DEPTH_COMPONENT24:y===bi?F=i.DEPTH_COMPONENT32F:y===Zr&&(F=i.DEPTH_COMPONENT16),F}function C(I,y){return m(I)===!0||I.isFramebufferTexture&&I.minFilter!==kn&&I.minFilter!==Mi?Math.log2(Math.max(y.width,y.height))+1:I.mipmaps!==void 0&&I.mipmaps.length>0?I.mipmaps.length:I.isCompressedTexture&&Array.isArray(I.image)?y.mipmaps.length:1}function A(I){let y=I.target;y.removeEventListener("dispose",A),U(y),y.isVideoTexture&&h.delete(y)}function D(I){let y=I.target;y.removeEventListener("dispose",D),b(y)}function U(I){let y=n.get(I);if(y.__webglInit===void 0)return;let F=I.source,Z=d.get(F);if(Z){let nt=Z[y.__cacheKey];nt.usedTimes--,nt.usedTimes===0&&S(I),Object.keys(Z).length===0&&d.delete(F)}n.remove(I)}function S(I){let y=n.get(I);i.deleteTexture(y.__webglTexture);let F=I.source,Z=d.get(F);delete Z[y.__cacheKey],o.memory.textures--}function b(I){let y=n.get(I);if(I.depthTexture&&(I.depthTexture.dispose(),n.remove(I.depthTexture)),I.isWebGLCubeRenderTarget)for(let Z=0;Z<6;Z++){if(Array.isArray(y.__webglFramebuffer[Z]))for(let nt=0;nt<y.__webglFramebuffer[Z].length;nt++)i.deleteFramebuffer(y.__webglFramebuffer[Z][nt]);else i.deleteFramebuffer(y.__webglFramebuffer[Z]);y.__webglDepthbuffer&&i.deleteRenderbuffer(y.__webglDepthbuffer[Z])}else{if(Array.isArray(y.__webglFramebuffer))for(let Z=0;Z<y.__webglFramebuffer.length;Z++)i.deleteFramebuffer(y.__webglFramebuffer[Z]);else i.deleteFramebuffer(y.__webglFramebuffer);if(y.__webglDepthbuffer&&i.deleteRenderbuffer(y.__webglDepthbuffer),y.__webglMultisampledFramebuffer&&i.deleteFramebuffer(y.__webglMultisampledFramebuffer),y.__webglColorRenderbuffer)for(let Z=0;Z<y.__webglColorRenderbuffer.length;Z++)y.__webglColorRenderbuffer[Z]&&i.deleteRenderbuffer(y.__webglColorRenderbuffer[Z]);y.__webglDepthRenderbuffer&&i.deleteRenderbuffer(y.__webglDepthRenderbuffer)}let F=I.textures;for(let Z=0,nt=F.length;Z<nt;Z++){let tt=n.get(F[Z]);tt.__webglTexture&&(i.deleteTexture(tt.__webglTexture),o.memory.textures--),n.remove(F[Z])}n.remove(I)}let P=0;function O(){P=0}function z(){let I=P;return I>=s.maxTextures&&console.warn("THREE.WebGLTextures: Trying to use "+I+" texture units while this GPU supports only "+s.maxTextures),P+=1,I}function W(I){let y=[];return y.push(I.wrapS),y.push(I.wrapT),y.push(I.wrapR||0),y.push(I.magFilter),y.push(I.minFilter),y.push(I.anisotropy),y.push(I.internalFormat),y.push(I.format),y.push(I.type),y.push(I.generateMipmaps),y.push(I.premultiplyAlpha),y.push(I.flipY),y.push(I.unpackAlignment),y.push(I.colorSpace),y.join()}function X(I,y){let F=n.get(I);if(I.isVideoTexture&&Ht(I),I.isRenderTargetTexture===!1&&I.isExternalTexture!==!0&&I.version>0&&F.__version!==I.version){let Z=I.image;if(Z===null)console.warn("THREE.WebGLRenderer: Texture marked for update but no image data found.");else if(Z.complete===!1)console.warn("THREE.WebGLRenderer: Texture marked for update but image is incomplete");else{Q(F,I,y);return}}else I.isExternalTexture&&(F.__webglTexture=I.sourceTexture?I.sourceTexture:null);e.bindTexture(i.TEXTURE_2D,F.__webglTexture,i.TEXTURE0+y)}function Y(I,y){let F=n.get(I);if(I.isRenderTargetTexture===!1&&I.version>0&&F.__version!==I.version){Q(F,I,y);return}e.bindTexture(i.TEXTURE_2D_ARRAY,F.__webglTexture,i.TEXTURE0+y)}function j(I,y){let F=n.get(I);if(I.isRenderTargetTexture===!1&&I.version>0&&F.__version!==I.version){Q(F,I,y);return}e.bindTexture(i.TEXTURE_3D,F.__webglTexture,i.TEXTURE0+y)}function K(I,y){let F=n.get(I);if(I.version>0&&F.__version!==I.version){et(F,I,y);return}e.bindTexture(i.TEXTURE_CUBE_MAP,F.__webglTexture,i.TEXTURE0+y)}let at={[Ka]:i.REPEAT,[gs]:i.CLAMP_TO_EDGE,[ja]:i.MIRRORED_REPEAT},lt={[kn]:i.NEAREST,[$p]:i.NEAREST_MIPMAP_NEAREST,[Jo]:i.NEAREST_MIPMAP_LINEAR,[Mi]:i.LINEAR,[Cl]:i.LINEAR_MIPMAP_NEAREST,[Ts]:i.LINEAR_MIPMAP_LINEAR},xt={[Qp]:i.NEVER,[rm]:i.ALWAYS,[tm]:i.LESS,[ou]:i.LEQUAL,[em]:i.EQUAL,[sm]:i.GEQUAL,[nm]:i.GREATER,[im]:i.NOTEQUAL};function Mt(I,y){if(y.type===bi&&t.has("OES_texture_float_linear")===!1&&(y.magFilter===Mi||y.magFilter===Cl||y.magFilter===Jo||y.magFilter===Ts||y.minFilter===Mi||y.minFilter===Cl||y.minFilter===Jo||y.minFilter===Ts)&&console.warn("THREE.WebGLRenderer: Unable to use linear filtering with floating point textures. OES_texture_float_linear not supported on this device."),i.texParameteri(I,i.TEXTURE_WRAP_S,at[y.wrapS]),i.texParameteri(I,i.TEXTURE_WRAP_T,at[y.wrapT]),(I===i.TEXTURE_3D||I===i.TEXTURE_2D_ARRAY)&&i.texParameteri(I,i.TEXTURE_WRAP_R,at[y.wrapR]),i.texParameteri(I,i.TEXTURE_MAG_FILTER,lt[y.magFilter]),i.texParameteri(I,i.TEXTURE_MIN_FILTER,lt[y.minFilter]),y.compareFunction&&(i.texParameteri(I,i.TEXTURE_COMPARE_MODE,i.COMPARE_REF_TO_TEXTURE),i.texParameteri(I,i.TEXTURE_COMPARE_FUNC,xt[y.compareFunction])),t.has("EXT_texture_filter_anisotropic")===!0){if(y.magFilter===kn||y.minFilter!==Jo&&y.minFilter!==Ts||y.type===bi&&t.has("OES_texture_float_linear")===!1)return;if(y.anisotropy>1||n.get(y).__currentAnisotropy){let F=t.get("EXT_texture_filter_anisotropic");i.texParameterf(I,F.TEXTURE_MAX_ANISOTROPY_EXT,Math.min(y.anisotropy,s.getMaxAnisotropy())),n.get(y).__currentAnisotropy=y.anisotropy}}}function _t(I,y){let F=!1;I.__webglInit===void 0&&(I.__webglInit=!0,y.addEventListener("dispose",A));let Z=y.source,nt=d.get(Z);nt===void 0&&(nt={},d.set(Z,nt));let tt=W(y);if(tt!==I.__cacheKey){nt[tt]===void 0&&(nt[tt]={texture:i.createTexture(),usedTimes:0},o.memory.textures++,F=!0),nt[tt].usedTimes++;let Ut=nt[I.__cacheKey];Ut!==void 0&&(nt[I.__cacheKey].usedTimes--,Ut.usedTimes===0&&S(y)),I.__cacheKey=tt,I.__webglTexture=nt[tt].texture}return F}function ie(I,y,F){return Math.floor(Math.floor(I/F)/y)}function Qt(I,y,F,Z){let tt=I.updateRanges;if(tt.length===0)e.texSubImage2D(i.TEXTURE_2D,0,0,0,y.width,y.height,F,Z,y.data);else{tt.sort((ot,gt)=>ot.start-gt.start);let Ut=0;for(let ot=1;ot<tt.length;ot++){let gt=tt[Ut],Bt=tt[ot],Ot=gt.start+gt.count,vt=ie(Bt.start,y.width,4),Kt=ie(gt.start,y.width,4);Bt.start<=Ot+1&&vt===Kt&&ie(Bt.start+Bt.count-1,y.width,4)===vt?gt.count=Math.max(gt.count,Bt.start+Bt.count-gt.start):(++Ut,tt[Ut]=Bt)}tt.length=Ut+1;let ut=i.getParameter(i.UNPACK_ROW_LENGTH),It=i.getParameter(i.UNPACK_SKIP_PIXELS),At=i.getParameter(i.UNPACK_SKIP_ROWS);i.pixelStorei(i.UNPACK_ROW_LENGTH,y.width);for(let ot=0,gt=tt.length;ot<gt;ot++){let Bt=tt[ot],Ot=Math.floor(Bt.start/4),vt=Math.ceil(Bt.count/4),Kt=Ot%y.width,B=Math.floor(Ot/y.width),dt=vt,pt=1;i.pixelStorei(i.UNPACK_SKIP_PIXELS,Kt),i.pixelStorei(i.UNPACK_SKIP_ROWS,B),e.texSubImage2D(i.TEXTURE_2D,0,Kt,B,dt,pt,F,Z,y.data)}I.clearUpdateRanges(),i.pixelStorei(i.UNPACK_ROW_LENGTH,ut),i.pixelStorei(i.UNPACK_SKIP_PIXELS,It),i.pixelStorei(i.UNPACK_SKIP_ROWS,At)}}function Q(I,y,F){let Z=i.TEXTURE_2D;(y.isDataArrayTexture||y.isCompressedArrayTexture)&&(Z=i.TEXTURE_2D_ARRAY),y.isData3DTexture&&(Z=i.TEXTURE_3D);let nt=_t(I,y),tt=y.source;e.bindTexture(Z,I.__webglTexture,i.TEXTURE0+F);let Ut=n.get(tt);if(tt.version!==Ut.__version||nt===!0){e.activeTexture(i.TEXTURE0+F);let ut=fe.getPrimaries(fe.workingColorSpace),It=y.colorSpace===Qi?null:fe.getPrimaries(y.colorSpace),At=y.colorSpace===Qi||ut===It?i.NONE:i.BROWSER_DEFAULT_WEBGL;i.pixelStorei(i.UNPACK_FLIP_Y_WEBGL,y.flipY),i.pixelStorei(i.UNPACK_PREMULTIPLY_ALPHA_WEBGL,y.premultiplyAlpha),i.pixelStorei(i.UNPACK_ALIGNMENT,y.unpackAlignment),i.pixelStorei(i.UNPACK_COLORSPACE_CONVERSION_WEBGL,At);let ot=x(y.image,!1,s.maxTextureSize);ot=Be(y,ot);let gt=r.convert(y.format,y.colorSpace),Bt=r.convert(y.type),Ot=E(y.internalFormat,gt,Bt,y.colorSpace,y.isVideoTexture);Mt(Z,y);let vt,Kt=y.mipmaps,B=y.isVideoTexture!==!0,dt=Ut.__version===void 0||nt===!0,pt=tt.dataReady,Pt=C(y,ot);if(y.isDepthTexture)Ot=v(y.format===jr,y.type),dt&&(B?e.texStorage2D(i.TEXTURE_2D,1,Ot,ot.width,ot.height):e.texImage2D(i.TEXTURE_2D,0,Ot,ot.width,ot.height,0,gt,Bt,null));else if(y.isDataTexture)if(Kt.length>0){B&&dt&&e.texStorage2D(i.TEXTURE_2D,Pt,Ot,Kt[0].width,Kt[0].height);for(let ht=0,rt=Kt.length;ht<rt;ht++)vt=Kt[ht],B?pt&&e.texSubImage2D(i.TEXTURE_2D,ht,0,0,vt.width,vt.height,gt,Bt,vt.data):e.texImage2D(i.TEXTURE_2D,ht,Ot,vt.width,vt.height,0,gt,Bt,vt.data);y.generateMipmaps=!1}else B?(dt&&e.texStorage2D(i.TEXTURE_2D,Pt,Ot,ot.width,ot.height),pt&&Qt(y,ot,gt,Bt)):e.texImage2D(i.TEXTURE_2D,0,Ot,ot.width,ot.height,0,gt,Bt,ot.data);else if(y.isCompressedTexture)if(y.isCompressedArrayTexture){B&&dt&&e.texStorage3D(i.TEXTURE_2D_ARRAY,Pt,Ot,Kt[0].width,Kt[0].height,ot.depth);for(let ht=0,rt=Kt.length;ht<rt;ht++)if(vt=Kt[ht],y.format!==li)if(gt!==null)if(B){if(pt)if(y.layerUpdates.size>0){let Ft=pu(vt.width,vt.height,y.format,y.type);for(let ee of y.layerUpdates){let Te=vt.data.subarray(ee*Ft/vt.data.BYTES_PER_ELEMENT,(ee+1)*Ft/vt.data.BYTES_PER_ELEMENT);e.compressedTexSubImage3D(i.TEXTURE_2D_ARRAY,ht,0,0,ee,vt.width,vt.height,1,gt,Te)}y.clearLayerUpdates()}else e.compressedTexSubImage3D(i.TEXTURE_2D_ARRAY,ht,0,0,0,vt.width,vt.height,ot.depth,gt,vt.data)}else e.compressedTexImage3D(i.TEXTURE_2D_ARRAY,ht,Ot,vt.width,vt.height,ot.depth,0,vt.data,0,0);else console.warn("THREE.WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()");else B?pt&&e.texSubImage3D(i.TEXTURE_2D_ARRAY,ht,0,0,0,vt.width,vt.height,ot.depth,gt,Bt,vt.data):e.texImage3D(i.TEXTURE_2D_ARRAY,ht,Ot,vt.width,vt.height,ot.depth,0,gt,Bt,vt.data)}else{B&&dt&&e.texStorage2D(i.TEXTURE_2D,Pt,Ot,Kt[0].width,Kt[0].height);for(let ht=0,rt=Kt.length;ht<rt;ht++)vt=Kt[ht],y.format!==li?gt!==null?B?pt&&e.compressedTexSubImage2D(i.TEXTURE_2D,ht,0,0,vt.width,vt.height,gt,vt.data):e.compressedTexImage2D(i.TEXTURE_2D,ht,Ot,vt.width,vt.height,0,vt.data):console.warn("THREE.WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()"):B?pt&&e.texSubImage2D(i.TEXTURE_2D,ht,0,0,vt.width,vt.height,gt,Bt,vt.data):e.texImage2D(i.TEXTURE_2D,ht,Ot,vt.width,vt.height,0,gt,Bt,vt.data)}else if(y.isDataArrayTexture)if(B){if(dt&&e.texStorage3D(i.TEXTURE_2D_ARRAY,Pt,Ot,ot.width,ot.height,ot.depth),pt)if(y.layerUpdates.size>0){let ht=pu(ot.width,ot.height,y.format,y.type);for(let rt of y.layerUpdates){let Ft=ot.data.subarray(rt*ht/ot.data.BYTES_PER_ELEMENT,(rt+1)*ht/ot.data.BYTES_PER_ELEMENT);e.texSubImage3D(i.TEXTURE_2D_ARRAY,0,0,0,rt,ot.width,ot.height,1,gt,Bt,Ft)}y.clearLayerUpdates()}else e.texSubImage3D(i.TEXTURE_2D_ARRAY,0,0,0,0,ot.width,ot.height,ot.depth,gt,Bt,ot.data)}else e.texImage3D(i.TEXTURE_2D_ARRAY,0,Ot,ot.width,ot.height,ot.depth,0,gt,Bt,ot.data);else if(y.isData3DTexture)B?(dt&&e.texStorage3D(i.TEXTURE_3D,Pt,Ot,ot.width,ot.height,ot.depth),pt&&e.texSubImage3D(i.TEXTURE_3D,0,0,0,0,ot.width,ot.height,ot.depth,gt,Bt,ot.data)):e.texImage3D(i.TEXTURE_3D,0,Ot,ot.width,ot.height,ot.depth,0,gt,Bt,ot.data);else if(y.isFramebufferTexture){if(dt)if(B)e.texStorage2D(i.TEXTURE_2D,Pt,Ot,ot.width,ot.height);else{let ht=ot.width,rt=ot.height;for(let Ft=0;Ft<Pt;Ft++)e.texImage2D(i.TEXTURE_2D,Ft,Ot,ht,rt,0,gt,Bt,null),ht>>=1,rt>>=1}}else if(Kt.length>0){if(B&&dt){let ht=xe(Kt[0]);e.texStorage2D(i.TEXTURE_2D,Pt,Ot,ht.width,ht.height)}for(let ht=0,rt=Kt.length;ht<rt;ht++)vt=Kt[ht],B?pt&&e.texSubImage2D(i.TEXTURE_2D,ht,0,0,gt,Bt,vt):e.texImage2D(i.TEXTURE_2D,ht,Ot,gt,Bt,vt);y.generateMipmaps=!1}else if(B){if(dt){let ht=xe(ot);e.texStorage2D(i.TEXTURE_2D,Pt,Ot,ht.width,ht.height)}pt&&e.texSubImage2D(i.TEXTURE_2D,0,0,0,gt,Bt,ot)}else e.texImage2D(i.TEXTURE_2D,0,Ot,gt,Bt,ot);m(y)&&p(Z),Ut.__version=tt.version,y.onUpdate&&y.onUpdate(y)}I.__version=y.version}function et(I,y,F){if(y.image.length!==6)return;let Z=_t(I,y),nt=y.source;e.bindTexture(i.TEXTURE_CUBE_MAP,I.__webglTexture,i.TEXTURE0+F);let tt=n.get(nt);if(nt.version!==tt.__version||Z===!0){e.activeTexture(i.TEXTURE0+F);let Ut=fe.getPrimaries(fe.workingColorSpace),ut=y.colorSpace===Qi?null:fe.getPrimaries(y.colorSpace),It=y.colorSpace===Qi||Ut===ut?i.NONE:i.BROWSER_DEFAULT_WEBGL;i.pixelStorei(i.UNPACK_FLIP_Y_WEBGL,y.flipY),i.pixelStorei(i.UNPACK_PREMULTIPLY_ALPHA_WEBGL,y.premultiplyAlpha),i.pixelStorei(i.UNPACK_ALIGNMENT,y.unpackAlignment),i.pixelStorei(i.UNPACK_COLORSPACE_CONVERSION_WEBGL,It);let At=y.isCompressedTexture||y.image[0].isCompressedTexture,ot=y.image[0]&&y.image[0].isDataTexture,gt=[];for(let rt=0;rt<6;rt++)!At&&!ot?gt[rt]=x(y.image[rt],!0,s.maxCubemapSize):gt[rt]=ot?y.image[rt].image:y.image[rt],gt[rt]=Be(y,gt[rt]);let Bt=gt[0],Ot=r.convert(y.format,y.colorSpace),vt=r.convert(y.type),Kt=E(y.internalFormat,Ot,vt,y.colorSpace),B=y.isVideoTexture!==!0,dt=tt.__version===void 0||Z===!0,pt=nt.dataReady,Pt=C(y,Bt);Mt(i.TEXTURE_CUBE_MAP,y);let ht;if(At){B&&dt&&e.texStorage2D(i.TEXTURE_CUBE_MAP,Pt,Kt,Bt.width,Bt.height);for(let rt=0;rt<6;rt++){ht=gt[rt].mipmaps;for(let Ft=0;Ft<ht.length;Ft++){let ee=ht[Ft];y.format!==li?Ot!==null?B?pt&&e.compressedTexSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft,0,0,ee.width,ee.height,Ot,ee.data):e.compressedTexImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft,Kt,ee.width,ee.height,0,ee.data):console.warn("THREE.WebGLRenderer: Attempt to load unsupported compressed texture format in .setTextureCube()"):B?pt&&e.texSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft,0,0,ee.width,ee.height,Ot,vt,ee.data):e.texImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft,Kt,ee.width,ee.height,0,Ot,vt,ee.data)}}}else{if(ht=y.mipmaps,B&&dt){ht.length>0&&Pt++;let rt=xe(gt[0]);e.texStorage2D(i.TEXTURE_CUBE_MAP,Pt,Kt,rt.width,rt.height)}for(let rt=0;rt<6;rt++)if(ot){B?pt&&e.texSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,0,0,0,gt[rt].width,gt[rt].height,Ot,vt,gt[rt].data):e.texImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,0,Kt,gt[rt].width,gt[rt].height,0,Ot,vt,gt[rt].data);for(let Ft=0;Ft<ht.length;Ft++){let Te=ht[Ft].image[rt].image;B?pt&&e.texSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft+1,0,0,Te.width,Te.height,Ot,vt,Te.data):e.texImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft+1,Kt,Te.width,Te.height,0,Ot,vt,Te.data)}}else{B?pt&&e.texSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,0,0,0,Ot,vt,gt[rt]):e.texImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,0,Kt,Ot,vt,gt[rt]);for(let Ft=0;Ft<ht.length;Ft++){let ee=ht[Ft];B?pt&&e.texSubImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft+1,0,0,Ot,vt,ee.image[rt]):e.texImage2D(i.TEXTURE_CUBE_MAP_POSITIVE_X+rt,Ft+1,Kt,Ot,vt,ee.image[rt])}}}m(y)&&p(i.TEXTURE_CUBE_MAP),tt.__version=nt.version,y.onUpdate&&y.onUpdate(y)}I.__version=y.version}function wt(I,y,F,Z,nt,tt){let Ut=r.convert(F.format,F.colorSpace),ut=r.convert(F.type),It=E(F.internalFormat,Ut,ut,F.colorSpace),At=n.get(y),ot=n.get(F);if(ot.__renderTarget=y,!At.__hasExternalTextures){let gt=Math.max(1,y.width>>tt),Bt=Math.max(1,y.height>>tt);nt===i.TEXTURE_3D||nt===i.TEXTURE_2D_ARRAY?e.texImage3D(nt,tt,It,gt,Bt,y.depth,0,Ut,ut,null):e.texImage2D(nt,tt,It,gt,Bt,0,Ut,ut,null)}e.bindFramebuffer(i.FRAMEBUFFER,I),Ct(y)?a.framebufferTexture2DMultisampleEXT(i.FRAMEBUFFER,Z,nt,ot.__webglTexture,0,be(y)):(nt===i.TEXTURE_2D||nt>=i.TEXTURE_CUBE_MAP_POSITIVE_X&&nt<=i.TEXTURE_CUBE_MAP_NEGATIVE_Z)&&i.framebufferTexture2D(i.FRAMEBUFFER,Z,nt,ot.__webglTexture,tt),e.bindFramebuffer(i.FRAMEBUFFER,null)}function kt(I,y,F){if(i.bindRenderbuffer(i.RENDERBUFFER,I),y.depthBuffer){let Z=y.depthTexture,nt=Z&&Z.isDepthTexture?Z.type:null,tt=v(y.stencilBuffer,nt),Ut=y.stencilBuffer?i.DEPTH_STENCIL_ATTACHMENT:i.DEPTH_ATTACHMENT,ut=be(y);Ct(y)?a.renderbufferStorageMultisampleEXT(i.RENDERBUFFER,ut,tt,y.width,y.height):F?i.renderbufferStorageMultisample(i.RENDERBUFFER,ut,tt,y.width,y.height):i.renderbufferStorage(i.RENDERBUFFER,tt,y.width,y.height),i.framebufferRenderbuffer(i.FRAMEBUFFER,Ut,i.RENDERBUFFER,I)}else{let Z=y.textures;for(let nt=0;nt<Z.length;nt++){let tt=Z[nt],Ut=r.convert(tt.format,tt.colorSpace),ut=r.convert(tt.type),It=E(tt.internalFormat,Ut,ut,tt.colorSpace),At=be(y);F&&Ct(y)===!1?i.renderbufferStorageMultisample(i.RENDERBUFFER,At,It,y.width,y.height):Ct(y)?a.renderbufferStorageMultisampleEXT(i.RENDERBUFFER,At,It,y.width,y.height):i.renderbufferStorage(i.RENDERBUFFER,It,y.width,y.height)}}i.bindRenderbuffer(i.RENDERBUFFER,null)}function yt(I,y){if(y&&y.isWebGLCubeRenderTarget)throw new Error("Depth Texture with cube render targets is not supported");if(e.bindFramebuffer(i.FRAMEBUFFER,I),!(y.depthTexture&&y.depthTexture.isDepthTexture))throw new Error("renderTarget.depthTexture must be an instance of THREE.DepthTexture");let Z=n.get(y.depthTexture);Z.__renderTarget=y,(!Z.__webglTexture||y.depthTexture.image.width!==y.width||y.depthTexture.image.height!==y.height)&&(y.depthTexture.image.width=y.width,y.depthTexture.image.height=y.height,y.depthTexture.needsUpdate=!0),X(y.depthTexture,0);let nt=Z.__webglTexture,tt=be(y);if(y.depthTexture.format===Vr)Ct(y)?a.framebufferTexture2DMultisampleEXT(i.FRAMEBUFFER,i.DEPTH_ATTACHMENT,i.TEXTURE_2D,nt,0,tt):i.framebufferTexture2D(i.FRAMEBUFFER,i.DEPTH_ATTACHMENT,i.TEXTURE_2D,nt,0);else if(y.depthTexture.format===jr)Ct(y)?a.framebufferTexture2DMultisampleEXT(i.FRAMEBUFFER,i.DEPTH_STENCIL_ATTACHMENT,i.TEXTURE_2D,nt,0,tt):i.framebufferTexture2D(i.FRAMEBUFFER,i.DEPTH_STENCIL_ATTACHMENT,i.TEXTURE_2D,nt,0);else throw new Error("Unknown depthTexture format")}function te(I){let y=n.get(I),F=I.isWebGLCubeRenderTarget===!0;if(y.__boundDepthTexture!==I.depthTexture){let Z=I.depthTexture;if(y.__depthDisposeCallback&&y.__depthDisposeCallback(),Z){let nt=()=>{delete y.__boundDepthTexture,delete y.__depthDisposeCallback,Z.removeEventListener("dispose",nt)};Z.addEventListener("dispose",nt),y.__depthDisposeCallback=nt}y.__boundDepthTexture=Z}if(I.depthTexture&&!y.__autoAllocateDepthBuffer){if(F)throw new Error("target.depthTexture not supported in Cube render targets");let Z=I.texture.mipmaps;Z&&Z.length>0?yt(y.__webglFramebuffer[0],I):yt(y.__webglFramebuffer,I)}else if(F){y.__webglDepthbuffer=[];for(let Z=0;Z<6;Z++)if(e.bindFramebuffer(i.FRAMEBUFFER,y.__webglFramebuffer[Z]),y.__webglDepthbuffer[Z]===void 0)y.__webglDepthbuffer[Z]=i.createRenderbuffer(),kt(y.__webglDepthbuffer[Z],I,!1);else{let nt=I.stencilBuffer?i.DEPTH_STENCIL_ATTACHMENT:i.DEPTH_ATTACHMENT,tt=y.__webglDepthbuffer[Z];i.bindRenderbuffer(i.RENDERBUFFER,tt),i.framebufferRenderbuffer(i.FRAMEBUFFER,nt,i.RENDERBUFFER,tt)}}else{let Z=I.texture.mipmaps;if(Z&&Z.length>0?e.bindFramebuffer(i.FRAMEBUFFER,y.__webglFramebuffer[0]):e.bindFramebuffer(i.FRAMEBUFFER,y.__webglFramebuffer),y.__webglDepthbuffer===void 0)y.__webglDepthbuffer=i.createRenderbuffer(),kt(y.__webglDepthbuffer,I,!1);else{let nt=I.stencilBuffer?i.DEPTH_STENCIL_ATTACHMENT:i.DEPTH_ATTACHMENT,tt=y.__webglDepthbuffer;i.bindRenderbuffer(i.RENDERBUFFER,tt),i.framebufferRenderbuffer(i.FRAMEBUFFER,nt,i.RENDERBUFFER,tt)}}e.bindFramebuffer(i.FRAMEBUFFER,null)}function De(I,y,F){let Z=n.get(I);y!==void 0&&wt(Z.__webglFramebuffer,I,I.texture,i.COLOR_ATTACHMENT0,i.TEXTURE_2D,0),F!==void 0&&te(I)}function N(I){let y=I.texture,F=n.get(I),Z=n.get(y);I.addEventListener("dispose",D);let nt=I.textures,tt=I.isWebGLCubeRenderTarget===!0,Ut=nt.length>1;if(Ut||(Z.__webglTexture===void 0&&(Z.__webglTexture=i.createTexture()),Z.__version=y.version,o.memory.textures++),tt){F.__webglFramebuffer=[];for(let ut=0;ut<6;ut++)if(y.mipmaps&&y.mipmaps.length>0){F.__webglFramebuffer[ut]=[];for(let It=0;It<y.mipmaps.length;It++)F.__webglFramebuffer[ut][It]=i.createFramebuffer()}else F.__webglFramebuffer[ut]=i.createFramebuffer()}else{if(y.mipmaps&&y.mipmaps.length>0){F.__webglFramebuffer=[];for(let ut=0;ut<y.mipmaps.length;ut++)F.__webglFramebuffer[ut]=i.createFramebuffer()}else F.__webglFramebuffer=i.createFramebuffer();if(Ut)for(let ut=0,It=nt.length;ut<It;ut++){let At=n.get(nt[ut]);At.__webglTexture===void 0&&(At.__webglTexture=i.createTexture(),o.memory.textures++)}if(I.samples>0&&Ct(I)===!1){F.__webglMultisampledFramebuffer=i.createFramebuffer(),F.__webglColorRenderbuffer=[],e.bindFramebuffer(i.FRAMEBUFFER,F.__webglMultisampledFramebuffer);for(let ut=0;ut<nt.length;ut++){let It=nt[ut];F.__webglColorRenderbuffer[ut]=i.createRenderbuffer(),i.bindRenderbuffer(i.RENDERBUFFER,F.__webglColorRenderbuffer[ut]);let At=r.convert(It.format,It.colorSpace),ot=r.convert(It.type),gt=E(It.internalFormat,At,ot,It.colorSpace,I.isXRRenderTarget===!0),Bt=be(I);i.renderbufferStorageMultisample(i.RENDERBUFFER,Bt,gt,I.width,I.height),i.framebufferRenderbuffer(i.FRAMEBUFFER,i.COLOR_ATTACHMENT0+ut,i.RENDERBUFFER,F.__webglColorRenderbuffer[ut])}i.bindRenderbuffer(i.RENDERBUFFER,null),I.depthBuffer&&(F.__webglDepthRenderbuffer=i.createRenderbuffer(),kt(F.__webglDepthRenderbuffer,I,!0)),e.bindFramebuffer(i.FRAMEBUFFER,null)}}if(tt){e.bindTexture(i.TEXTURE_CUBE_MAP,Z.__webglTexture),Mt(i.TEXTURE_CUBE_MAP,y);for(let ut=0;ut<6;ut++)if(y.mipmaps&&y.mipmaps.length>0)for(let It=0;It<y.mipmaps.length;It++)wt(F.__webglFramebuffer[ut][It],I,y,i.COLOR_ATTACHMENT0,i.TEXTURE_CUBE_MAP_POSITIVE_X+ut,It);else wt(F.__webglFramebuffer[ut],I,y,i.COLOR_ATTACHMENT0,i.TEXTURE_CUBE_MAP_POSITIVE_X+ut,0);m(y)&&p(i.TEXTURE_CUBE_MAP),e.unbindTexture()}else if(Ut){for(let ut=0,It=nt.length;ut<It;ut++){let At=nt[ut],ot=n.get(At),gt=i.TEXTURE_2D;(I.isWebGL3DRenderTarget||I.isWebGLArrayRenderTarget)&&(gt=I.isWebGL3DRenderTarget?i.TEXTURE_3D:i.TEXTURE_2D_ARRAY),e.bindTexture(gt,ot.__webglTexture),Mt(gt,At),wt(F.__webglFramebuffer,I,At,i.COLOR_ATTACHMENT0+ut,gt,0),m(At)&&p(gt)}e.unbindTexture()}else{let ut=i.TEXTURE_2D;if((I.isWebGL3DRenderTarget||I.isWebGLArrayRenderTarget)&&(ut=I.isWebGL3DRenderTarget?i.TEXTURE_3D:i.TEXTURE_2D_ARRAY),e.bindTexture(ut,Z.__webglTexture),Mt(ut,y),y.mipmaps&&y.mipmaps.length>0)for(let It=0;It<y.mipmaps.length;It++)wt(F.__webglFramebuffer[It],I,y,i.COLOR_ATTACHMENT0,ut,It);else wt(F.__webglFramebuffer,I,y,i.COLOR_ATTACHMENT0,ut,0);m(y)&&p(ut),e.unbindTexture()}I.depthBuffer&&te(I)}function de(I){let y=I.textures;for(let F=0,Z=y.length;F<Z;F++){let nt=y[F];if(m(nt)){let tt=w(I),Ut=n.get(nt).__webglTexture;e.bindTexture(tt,Ut),p(tt),e.unbindTexture()}}}let $t=[],Gt=[];function Nt(I){if(I.samples>0){if(Ct(I)===!1){let y=I.textures,F=I.width,Z=I.height,nt=i.COLOR_BUFFER_BIT,tt=I.stencilBuffer?i.DEPTH_STENCIL_ATTACHMENT:i.DEPTH_ATTACHMENT,Ut=n.get(I),ut=y.length>1;if(ut)for(let At=0;At<y.length;At++)e.bindFramebuffer(i.FRAMEBUFFER,Ut.__webglMultisampledFramebuffer),i.framebufferRenderbuffer(i.FRAMEBUFFER,i.COLOR_ATTACHMENT0+At,i.RENDERBUFFER,null),e.bindFramebuffer(i.FRAMEBUFFER,Ut.__webglFramebuffer),i.framebufferTexture2D(i.DRAW_FRAMEBUFFER,i.COLOR_ATTACHMENT0+At,i.TEXTURE_2D,null,0);e.bindFramebuffer(i.READ_FRAMEBUFFER,Ut.__webglMultisampledFramebuffer);let It=I.texture.mipmaps;It&&It.length>0?e.bindFramebuffer(i.DRAW_FRAMEBUFFER,Ut.__webglFramebuffer[0]):e.bindFramebuffer(i.DRAW_FRAMEBUFFER,Ut.__webglFramebuffer);for(let At=0;At<y.length;At++){if(I.resolveDepthBuffer&&(I.depthBuffer&&(nt|=i.DEPTH_BUFFER_BIT),I.stencilBuffer&&I.resolveStencilBuffer&&(nt|=i.STENCIL_BUFFER_BIT)),ut){i.framebufferRenderbuffer(i.READ_FRAMEBUFFER,i.COLOR_ATTACHMENT0,i.RENDERBUFFER,Ut.__webglColorRenderbuffer[At]);let ot=n.get(y[At]).__webglTexture;i.framebufferTexture2D(i.DRAW_FRAMEBUFFER,i.COLOR_ATTACHMENT0,i.TEXTURE_2D,ot,0)}i.blitFramebuffer(0,0,F,Z,0,0,F,Z,nt,i.NEAREST),c===!0&&($t.length=0,Gt.length=0,$t.push(i.COLOR_ATTACHMENT0+At),I.depthBuffer&&I.resolveDepthBuffer===!1&&($t.push(tt),Gt.push(tt),i.invalidateFramebuffer(i.DRAW_FRAMEBUFFER,Gt)),i.invalidateFramebuffer(i.READ_FRAMEBUFFER,$t))}if(e.bindFramebuffer(i.READ_FRAMEBUFFER,null),e.bindFramebuffer(i.DRAW_FRAMEBUFFER,null),ut)for(let At=0;At<y.length;At++){e.bindFramebuffer(i.FRAMEBUFFER,Ut.__webglMultisampledFramebuffer),i.framebufferRenderbuffer(i.FRAMEBUFFER,i.COLOR_ATTACHMENT0+At,i.RENDERBUFFER,Ut.__webglColorRenderbuffer[At]);let ot=n.get(y[At]).__webglTexture;e.bindFramebuffer(i.FRAMEBUFFER,Ut.__webglFramebuffer),i.framebufferTexture2D(i.DRAW_FRAMEBUFFER,i.COLOR_ATTACHMENT0+At,i.TEXTURE_2D,ot,0)}e.bindFramebuffer(i.DRAW_FRAMEBUFFER,Ut.__webglMultisampledFramebuffer)}else if(I.depthBuffer&&I.resolveDepthBuffer===!1&&c){let y=I.stencilBuffer?i.DEPTH_STENCIL_ATTACHMENT:i.DEPTH_ATTACHMENT;i.invalidateFramebuffer(i.DRAW_FRAMEBUFFER,[y])}}}function be(I){return Math.min(s.maxSamples,I.samples)}function Ct(I){let y=n.get(I);return I.samples>0&&t.has("WEBGL_multisampled_render_to_texture")===!0&&y.__useRenderToTexture!==!1}function Ht(I){let y=o.render.frame;h.get(I)!==y&&(h.set(I,y),I.update())}function Be(I,y){let F=I.colorSpace,Z=I.format,nt=I.type;return I.isCompressedTexture===!0||I.isVideoTexture===!0||F!==$s&&F!==Qi&&(fe.getTransfer(F)===Ee?(Z!==li||nt!==Ni)&&console.warn("THREE.WebGLTextures: sRGB encoded textures have to use RGBAFormat and UnsignedByteType."):console.error("THREE.WebGLTextures: Unsupported texture color space:",F)),y}function xe(I){return typeof HTMLImageElement<"u"&&I instanceof HTMLImageElement?(l.width=I.naturalWidth||I.width,l.height=I.naturalHeight||I.height):typeof VideoFrame<"u"&&I instanceof VideoFrame?(l.width=I.displayWidth,l.height=I.displayHeight):(l.width=I.width,l.height=I.height),l}this.allocateTextureUnit=z,this.resetTextureUnits=O,this.setTexture2D=X,this.setTexture2DArray=Y,this.setTexture3D=j,this.setTextureCube=K,this.rebindTextures=De,this.setupRenderTarget=N,this.updateRenderTargetMipmap=de,this.updateMultisampleRenderTarget=Nt,this.setupDepthRenderbuffer=te,this.setupFrameBufferTexture=wt,this.useMultisampledRTT=Ct}function fS(i,t){function e(n,s=Qi){let r,o=fe.getTransfer(s);if(n===Ni)return i.UNSIGNED_BYTE;if(n===Il)return i.UNSIGNED_SHORT_4_4_4_4;if(n===Ll)return i.UNSIGNED_SHORT_5_5_5_1;if(n===eu)return i.UNSIGNED_INT_5_9_9_9_REV;if(n===nu)return i.UNSIGNED_INT_10F_11F_11F_REV;if(n===Qh)return i.BYTE;if(n===tu)return i.SHORT;if(n===Zr)return i.UNSIGNED_SHORT;if(n===Pl)return i.INT;if(n===As)return i.UNSIGNED_INT;if(n===bi)return i.FLOAT;if(n===Jr)return i.HALF_FLOAT;if(n===iu)return i.ALPHA;if(n===su)return i.RGB;if(n===li)return i.RGBA;if(n===Vr)return i.DEPTH_COMPONENT;if(n===jr)return i.DEPTH_STENCIL;if(n===Dl)return i.RED;if(n===Nl)return i.RED_INTEGER;if(n===ru)return i.RG;if(n===Ul)return i.RG_INTEGER;if(n===Fl)return i.RGBA_INTEGER;if(n===Ko||n===jo||n===Qo||n===ta)if(o===Ee)if(r=t.get("WEBGL_compressed_texture_s3tc_srgb"),r!==null){if(n===Ko)return r.COMPRESSED_SRGB_S3TC_DXT1_EXT;if(n===jo)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT1_EXT;if(n===Qo)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT3_EXT;if(n===ta)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT5_EXT}else return null;else if(r=t.get("WEBGL_compressed_texture_s3tc"),r!==null){if(n===Ko)return r.COMPRESSED_RGB_S3TC_DXT1_EXT;if(n===jo)return r.COMPRESSED_RGBA_S3TC_DXT1_EXT;if(n===Qo)return r.COMPRESSED_RGBA_S3TC_DXT3_EXT;if(n===ta)return r.COMPRESSED_RGBA_S3TC_DXT5_EXT}else return null;if(n===Ol||n===Bl||n===kl||n===zl)if(r=t.get("WEBGL_compressed_texture_pvrtc"),r!==null){if(n===Ol)return r.COMPRESSED_RGB_PVRTC_4BPPV1_IMG;if(n===Bl)return r.COMPRESSED_RGB_PVRTC_2BPPV1_IMG;if(n===kl)return r.COMPRESSED_RGBA_PVRTC_4BPPV1_IMG;if(n===zl)return r.COMPRESSED_RGBA_PVRTC_2BPPV1_IMG}else return null;if(n===Vl||n===Hl||n===Gl)if(r=t.get("WEBGL_compressed_texture_etc"),r!==null){if(n===Vl||n===Hl)return o===Ee?r.COMPRESSED_SRGB8_ETC2:r.COMPRESSED_RGB8_ETC2;if(n===Gl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ETC2_EAC:r.COMPRESSED_RGBA8_ETC2_EAC}else return null;if(n===Wl||n===Xl||n===ql||n===Yl||n===$l||n===Zl||n===Jl||n===Kl||n===jl||n===Ql||n===tc||n===ec||n===nc||n===ic)if(r=t.get("WEBGL_compressed_texture_astc"),r!==null){if(n===Wl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_4x4_KHR:r.COMPRESSED_RGBA_ASTC_4x4_KHR;if(n===Xl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_5x4_KHR:r.COMPRESSED_RGBA_ASTC_5x4_KHR;if(n===ql)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_5x5_KHR:r.COMPRESSED_RGBA_ASTC_5x5_KHR;if(n===Yl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_6x5_KHR:r.COMPRESSED_RGBA_ASTC_6x5_KHR;if(n===$l)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_6x6_KHR:r.COMPRESSED_RGBA_ASTC_6x6_KHR;if(n===Zl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x5_KHR:r.COMPRESSED_RGBA_ASTC_8x5_KHR;if(n===Jl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x6_KHR:r.COMPRESSED_RGBA_ASTC_8x6_KHR;if(n===Kl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x8_KHR:r.COMPRESSED_RGBA_ASTC_8x8_KHR;if(n===jl)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x5_KHR:r.COMPRESSED_RGBA_ASTC_10x5_KHR;if(n===Ql)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x6_KHR:r.COMPRESSED_RGBA_ASTC_10x6_KHR;if(n===tc)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x8_KHR:r.COMPRESSED_RGBA_ASTC_10x8_KHR;if(n===ec)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x10_KHR:r.COMPRESSED_RGBA_ASTC_10x10_KHR;if(n===nc)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_12x10_KHR:r.COMPRESSED_RGBA_ASTC_12x10_KHR;if(n===ic)return o===Ee?r.COMPRESSED_SRGB8_ALPHA8_ASTC_12x12_KHR:r.COMPRESSED_RGBA_ASTC_12x12_KHR}else return null;if(n===sc||n===rc||n===oc)if(r=t.get("EXT_texture_compression_bptc"),r!==null){if(n===sc)return o===Ee?r.COMPRESSED_SRGB_ALPHA_BPTC_UNORM_EXT:r.COMPRESSED_RGBA_BPTC_UNORM_EXT;if(n===rc)return r.COMPRESSED_RGB_BPTC_SIGNED_FLOAT_EXT;if(n===oc)return r.COMPRESSED_RGB_BPTC_UNSIGNED_FLOAT_EXT}else return null;if(n===ac||n===lc||n===cc||n===hc)if(r=t.get("EXT_texture_compression_rgtc"),r!==null){if(n===ac)return r.COMPRESSED_RED_RGTC1_EXT;if(n===lc)return r.COMPRESSED_SIGNED_RED_RGTC1_EXT;if(n===cc)return r.COMPRESSED_RED_GREEN_RGTC2_EXT;if(n===hc)return r.COMPRESSED_SIGNED_RED_GREEN_RGTC2_EXT}else return null;return n===Kr?i.UNSIGNED_INT_24_8:i[n]!==void 0?i[n]:null}return{convert:e}}var pS=`
void main() {

	gl_Position = vec4( position, 1.0 );

}`,mS=`
uniform sampler2DArray depthColor;
uniform float depthWidth;
uniform float depthHeight;

void main() {

	vec2 coord = vec2( gl_FragCoord.x / depthWidth, gl_FragCoord.y / depthHeight );

	if ( coord.x >= 1.0 ) {

		gl_FragDepth = texture( depthColor, vec3( coord.x - 1.0, coord.y, 1 ) ).r;

	} else {

		gl_FragDepth = texture( depthColor, vec3( coord.x, coord.y, 0 ) ).r;

	}

}`,Au=class{constructor(){this.texture=null,this.mesh=null,this.depthNear=0,this.depthFar=0}init(t,e){if(this.texture===null){let n=new Go(t.texture);(t.depthNear!==e.depthNear||t.depthFar!==e.depthFar)&&(this.depthNear=t.depthNear,this.depthFar=t.depthFar),this.texture=n}}getMesh(t){if(this.texture!==null&&this.mesh===null){let e=t.cameras[0].viewport,n=new on({vertexShader:pS,fragmentShader:mS,uniforms:{depthColor:{value:this.texture},depthWidth:{value:e.z},depthHeight:{value:e.w}}});this.mesh=new tn(new qo(20,20),n)}return this.mesh}reset(){this.texture=null,this.mesh=null}getDepthTexture(){return this.texture}},Ru=class extends Pi{constructor(t,e){super();let n=this,s=null,r=1,o=null,a="local-floor",c=1,l=null,h=null,u=null,d=null,f=null,g=null,x=typeof XRWebGLBinding<"u",m=new Au,p={},w=e.getContextAttributes(),E=null,v=null,C=[],A=[],D=new Jt,U=null,S=new wn;S.viewport=new Ze;let b=new wn;b.viewport=new Ze;let P=[S,b],O=new yl,z=null,W=null;this.cameraAutoUpdate=!0,this.enabled=!1,this.isPresenting=!1,this.getController=function(Q){let et=C[Q];return et===void 0&&(et=new qr,C[Q]=et),et.getTargetRaySpace()},this.getControllerGrip=function(Q){let et=C[Q];return et===void 0&&(et=new qr,C[Q]=et),et.getGripSpace()},this.getHand=function(Q){let et=C[Q];return et===void 0&&(et=new qr,C[Q]=et),et.getHandSpace()};function X(Q){let et=A.indexOf(Q.inputSource);if(et===-1)return;let wt=C[et];wt!==void 0&&(wt.update(Q.inputSource,Q.frame,l||o),wt.dispatchEvent({type:Q.type,data:Q.inputSource}))}function Y(){s.removeEventListener("select",X),s.removeEventListener("selectstart",X),s.removeEventListener("selectend",X),s.removeEventListener("squeeze",X),s.removeEventListener("squeezestart",X),s.removeEventListener("squeezeend",X),s.removeEventListener("end",Y),s.removeEventListener("inputsourceschange",j);for(let Q=0;Q<C.length;Q++){let et=A[Q];et!==null&&(A[Q]=null,C[Q].disconnect(et))}z=null,W=null,m.reset();for(let Q in p)delete p[Q];t.setRenderTarget(E),f=null,d=null,u=null,s=null,v=null,Qt.stop(),n.isPresenting=!1,t.setPixelRatio(U),t.setSize(D.width,D.height,!1),n.dispatchEvent({type:"sessionend"})}this.setFramebufferScaleFactor=function(Q){r=Q,n.isPresenting===!0&&console.warn("THREE.WebXRManager: Cannot change framebuffer scale while presenting.")},this.setReferenceSpaceType=function(Q){a=Q,n.isPresenting===!0&&console.warn("THREE.WebXRManager: Cannot change reference space type while presenting.")},this.getReferenceSpace=function(){return l||o},this.setReferenceSpace=function(Q){l=Q},this.getBaseLayer=function(){return d!==null?d:f},this.getBinding=function(){return u===null&&x&&(u=new XRWebGLBinding(s,e)),u},this.getFrame=function(){return g},this.getSession=function(){return s},this.setSession=async function(Q){if(s=Q,s!==null){if(E=t.getRenderTarget(),s.addEventListener("select",X),s.addEventListener("selectstart",X),s.addEventListener("selectend",X),s.addEventListener("squeeze",X),s.addEventListener("squeezestart",X),s.addEventListener("squeezeend",X),s.addEventListener("end",Y),s.addEventListener("inputsourceschange",j),w.xrCompatible!==!0&&await e.makeXRCompatible(),U=t.getPixelRatio(),t.getSize(D),x&&"createProjectionLayer"in XRWebGLBinding.prototype){let wt=null,kt=null,yt=null;w.depth&&(yt=w.stencil?e.DEPTH24_STENCIL8:e.DEPTH_COMPONENT24,wt=w.stencil?jr:Vr,kt=w.stencil?Kr:As);let te={colorFormat:e.RGBA8,depthFormat:yt,scaleFactor:r};u=this.getBinding(),d=u.createProjectionLayer(te),s.updateRenderState({layers:[d]}),t.setPixelRatio(1),t.setSize(d.textureWidth,d.textureHeight,!1),v=new Ii(d.textureWidth,d.textureHeight,{format:li,type:Ni,depthTexture:new Ho(d.textureWidth,d.textureHeight,kt,void 0,void 0,void 0,void 0,void 0,void 0,wt),stencilBuffer:w.stencil,colorSpace:t.outputColorSpace,samples:w.antialias?4:0,resolveDepthBuffer:d.ignoreDepthValues===!1,resolveStencilBuffer:d.ignoreDepthValues===!1})}else{let wt={antialias:w.antialias,alpha:!0,depth:w.depth,stencil:w.stencil,framebufferScaleFactor:r};f=new XRWebGLLayer(s,e,wt),s.updateRenderState({baseLayer:f}),t.setPixelRatio(1),t.setSize(f.framebufferWidth,f.framebufferHeight,!1),v=new Ii(f.framebufferWidth,f.framebufferHeight,{format:li,type:Ni,colorSpace:t.outputColorSpace,stencilBuffer:w.stencil,resolveDepthBuffer:f.ignoreDepthValues===!1,resolveStencilBuffer:f.ignoreDepthValues===!1})}v.isXRRenderTarget=!0,this.setFoveation(c),l=null,o=await s.requestReferenceSpace(a),Qt.setContext(s),Qt.start(),n.isPresenting=!0,n.dispatchEvent({type:"sessionstart"})}},this.getEnvironmentBlendMode=function(){if(s!==null)return s.environmentBlendMode},this.getDepthTexture=function(){return m.getDepthTexture()};function j(Q){for(let et=0;et<Q.removed.length;et++){let wt=Q.removed[et],kt=A.indexOf(wt);kt>=0&&(A[kt]=null,C[kt].disconnect(wt))}for(let et=0;et<Q.added.length;et++){let wt=Q.added[et],kt=A.indexOf(wt);if(kt===-1){for(let te=0;te<C.length;te++)if(te>=A.length){A.push(wt),kt=te;break}else if(A[te]===null){A[te]=wt,kt=te;break}if(kt===-1)break}let yt=C[kt];yt&&yt.connect(wt)}}let K=new H,at=new H;function lt(Q,et,wt){K.setFromMatrixPosition(et.matrixWorld),at.setFromMatrixPosition(wt.matrixWorld);let kt=K.distanceTo(at),yt=et.projectionMatrix.elements,te=wt.projectionMatrix.elements,De=yt[14]/(yt[10]-1),N=yt[14]/(yt[10]+1),de=(yt[9]+1)/yt[5],$t=(yt[9]-1)/yt[5],Gt=(yt[8]-1)/yt[0],Nt=(te[8]+1)/te[0],be=De*Gt,Ct=De*Nt,Ht=kt/(-Gt+Nt),Be=Ht*-Gt;if(et.matrixWorld.decompose(Q.position,Q.quaternion,Q.scale),Q.translateX(Be),Q.translateZ(Ht),Q.matrixWorld.compose(Q.position,Q.quaternion,Q.scale),Q.matrixWorldInverse.copy(Q.matrixWorld).invert(),yt[10]===-1)Q.projectionMatrix.copy(et.projectionMatrix),Q.projectionMatrixInverse.copy(et.projectionMatrixInverse);else{let xe=De+Ht,I=N+Ht,y=be-Be,F=Ct+(kt-Be),Z=de*N/I*xe,nt=$t*N/I*xe;Q.projectionMatrix.makePerspective(y,F,Z,nt,xe,I),Q.projectionMatrixInverse.copy(Q.projectionMatrix).invert()}}function xt(Q,et){et===null?Q.matrixWorld.copy(Q.matrix):Q.matrixWorld.multiplyMatrices(et.matrixWorld,Q.matrix),Q.matrixWorldInverse.copy(Q.matrixWorld).invert()}this.updateCamera=function(Q){if(s===null)return;let et=Q.near,wt=Q.far;m.texture!==null&&(m.depthNear>0&&(et=m.depthNear),m.depthFar>0&&(wt=m.depthFar)),O.near=b.near=S.near=et,O.far=b.far=S.far=wt,(z!==O.near||W!==O.far)&&(s.updateRenderState({depthNear:O.near,depthFar:O.far}),z=O.near,W=O.far),O.layers.mask=Q.layers.mask|6,S.layers.mask=O.layers.mask&3,b.layers.mask=O.layers.mask&5;let kt=Q.parent,yt=O.cameras;xt(O,kt);for(let te=0;te<yt.length;te++)xt(yt[te],kt);yt.length===2?lt(O,S,b):O.projectionMatrix.copy(S.projectionMatrix),Mt(Q,O,kt)};function Mt(Q,et,wt){wt===null?Q.matrix.copy(et.matrixWorld):(Q.matrix.copy(wt.matrixWorld),Q.matrix.invert(),Q.matrix.multiply(et.matrixWorld)),Q.matrix.decompose(Q.position,Q.quaternion,Q.scale),Q.updateMatrixWorld(!0),Q.projectionMatrix.copy(et.projectionMatrix),Q.projectionMatrixInverse.copy(et.projectionMatrixInverse),Q.isPerspectiveCamera&&(Q.fov=Hr*2*Math.atan(1/Q.projectionMatrix.elements[5]),Q.zoom=1)}this.getCamera=function(){return O},this.getFoveation=function(){if(!(d===null&&f===null))return c},this.setFoveation=function(Q){c=Q,d!==null&&(d.fixedFoveation=Q),f!==null&&f.fixedFoveation!==void 0&&(f.fixedFoveation=Q)},this.hasDepthSensing=function(){return m.texture!==null},this.getDepthSensingMesh=function(){return m.getMesh(O)},this.getCameraTexture=function(Q){return p[Q]};let _t=null;function ie(Q,et){if(h=et.getViewerPose(l||o),g=et,h!==null){let wt=h.views;f!==null&&(t.setRenderTargetFramebuffer(v,f.framebuffer),t.setRenderTarget(v));let kt=!1;wt.length!==O.cameras.length&&(O.cameras.length=0,kt=!0);for(let N=0;N<wt.length;N++){let de=wt[N],$t=null;if(f!==null)$t=f.getViewport(de);else{let Nt=u.getViewSubImage(d,de);$t=Nt.viewport,N===0&&(t.setRenderTargetTextures(v,Nt.colorTexture,Nt.depthStencilTexture),t.setRenderTarget(v))}let Gt=P[N];Gt===void 0&&(Gt=new wn,Gt.layers.enable(N),Gt.viewport=new Ze,P[N]=Gt),Gt.matrix.fromArray(de.transform.matrix),Gt.matrix.decompose(Gt.position,Gt.quaternion,Gt.scale),Gt.projectionMatrix.fromArray(de.projectionMatrix),Gt.projectionMatrixInverse.copy(Gt.projectionMatrix).invert(),Gt.viewport.set($t.x,$t.y,$t.width,$t.height),N===0&&(O.matrix.copy(Gt.matrix),O.matrix.decompose(O.position,O.quaternion,O.scale)),kt===!0&&O.cameras.push(Gt)}let yt=s.enabledFeatures;if(yt&&yt.includes("depth-sensing")&&s.depthUsage=="gpu-optimized"&&x){u=n.getBinding();let N=u.getDepthInformation(wt[0]);N&&N.isValid&&N.texture&&m.init(N,s.renderState)}if(yt&&yt.includes("camera-access")&&x){t.state.unbindTexture(),u=n.getBinding();for(let N=0;N<wt.length;N++){let de=wt[N].camera;if(de){let $t=p[de];$t||($t=new Go,p[de]=$t);let Gt=u.getCameraImage(de);$t.sourceTexture=Gt}}}}for(let wt=0;wt<C.length;wt++){let kt=A[wt],yt=C[wt];kt!==null&&yt!==void 0&&yt.update(kt,et,l||o)}_t&&_t(Q,et),et.detectedPlanes&&n.dispatchEvent({type:"planesdetected",data:et}),g=null}let Qt=new Nm;Qt.setAnimationLoop(ie),this.setAnimationLoop=function(Q){_t=Q},this.dispose=function(){}}},sr=new Li,gS=new Re;function _S(i,t){function e(m,p){m.matrixAutoUpdate===!0&&m.updateMatrix(),p.value.copy(m.matrix)}function n(m,p){p.color.getRGB(m.fogColor.value,uu(i)),p.isFog?(m.fogNear.value=p.near,m.fogFar.value=p.far):p.isFogExp2&&(m.fogDensity.value=p.density)}function s(m,p,w,E,v){p.isMeshBasicMaterial||p.isMeshLambertMaterial?r(m,p):p.isMeshToonMaterial?(r(m,p),u(m,p)):p.isMeshPhongMaterial?(r(m,p),h(m,p)):p.isMeshStandardMaterial?(r(m,p),d(m,p),p.isMeshPhysicalMaterial&&f(m,p,v)):p.isMeshMatcapMaterial?(r(m,p),g(m,p)):p.isMeshDepthMaterial?r(m,p):p.isMeshDistanceMaterial?(r(m,p),x(m,p)):p.isMeshNormalMaterial?r(m,p):p.isLineBasicMaterial?(o(m,p),p.isLineDashedMaterial&&a(m,p)):p.isPointsMaterial?c(m,p,w,E):p.isSpriteMaterial?l(m,p):p.isShadowMaterial?(m.color.value.copy(p.color),m.opacity.value=p.opacity):p.isShaderMaterial&&(p.uniformsNeedUpdate=!1)}function r(m,p){m.opacity.value=p.opacity,p.color&&m.diffuse.value.copy(p.color),p.emissive&&m.emissive.value.copy(p.emissive).multiplyScalar(p.emissiveIntensity),p.map&&(m.map.value=p.map,e(p.map,m.mapTransform)),p.alphaMap&&(m.alphaMap.value=p.alphaMap,e(p.alphaMap,m.alphaMapTransform)),p.bumpMap&&(m.bumpMap.value=p.bumpMap,e(p.bumpMap,m.bumpMapTransform),m.bumpScale.value=p.bumpScale,p.side===Fn&&(m.bumpScale.value*=-1)),p.normalMap&&(m.normalMap.value=p.normalMap,e(p.normalMap,m.normalMapTransform),m.normalScale.value.copy(p.normalScale),p.side===Fn&&m.normalScale.value.negate()),p.displacementMap&&(m.displacementMap.value=p.displacementMap,e(p.displacementMap,m.displacementMapTransform),m.displacementScale.value=p.displacementScale,m.displacementBias.value=p.displacementBias),p.emissiveMap&&(m.emissiveMap.value=p.emissiveMap,e(p.emissiveMap,m.emissiveMapTransform)),p.specularMap&&(m.specularMap.value=p.specularMap,e(p.specularMap,m.specularMapTransform)),p.alphaTest>0&&(m.alphaTest.value=p.alphaTest);let w=t.get(p),E=w.envMap,v=w.envMapRotation;E&&(m.envMap.value=E,sr.copy(v),sr.x*=-1,sr.y*=-1,sr.z*=-1,E.isCubeTexture&&E.isRenderTargetTexture===!1&&(sr.y*=-1,sr.z*=-1),m.envMapRotation.value.setFromMatrix4(gS.makeRotationFromEuler(sr)),m.flipEnvMap.value=E.isCubeTexture&&E.isRenderTargetTexture===!1?-1:1,m.reflectivity.value=p.reflectivity,m.ior.value=p.ior,m.refractionRatio.value=p.refractionRatio),p.lightMap&&(m.lightMap.value=p.lightMap,m.lightMapIntensity.value=p.lightMapIntensity,e(p.lightMap,m.lightMapTransform)),p.aoMap&&(m.aoMap.value=p.aoMap,m.aoMapIntensity.value=p.aoMapIntensity,e(p.aoMap,m.aoMapTransform))}function o(m,p){m.diffuse.value.copy(p.color),m.opacity.value=p.opacity,p.map&&(m.map.value=p.map,e(p.map,m.mapTransform))}function a(m,p){m.dashSize.value=p.dashSize,m.totalSize.value=p.dashSize+p.gapSize,m.scale.value=p.scale}function c(m,p,w,E){m.diffuse.value.copy(p.color),m.opacity.value=p.opacity,m.size.value=p.size*w,m.scale.value=E*.5,p.map&&(m.map.value=p.map,e(p.map,m.uvTransform)),p.alphaMap&&(m.alphaMap.value=p.alphaMap,e(p.alphaMap,m.alphaMapTransform)),p.alphaTest>0&&(m.alphaTest.value=p.alphaTest)}function l(m,p){m.diffuse.value.copy(p.color),m.opacity.value=p.opacity,m.rotation.value=p.rotation,p.map&&(m.map.value=p.map,e(p.map,m.mapTransform)),p.alphaMap&&(m.alphaMap.value=p.alphaMap,e(p.alphaMap,m.alphaMapTransform)),p.alphaTest>0&&(m.alphaTest.value=p.alphaTest)}function h(m,p){m.specular.value.copy(p.specular),m.shininess.value=Math.max(p.shininess,1e-4)}function u(m,p){p.gradientMap&&(m.gradientMap.value=p.gradientMap)}function d(m,p){m.metalness.value=p.metalness,p.metalnessMap&&(m.metalnessMap.value=p.metalnessMap,e(p.metalnessMap,m.metalnessMapTransform)),m.roughness.value=p.roughness,p.roughnessMap&&(m.roughnessMap.value=p.roughnessMap,e(p.roughnessMap,m.roughnessMapTransform)),p.envMap&&(m.envMapIntensity.value=p.envMapIntensity)}function f(m,p,w){m.ior.value=p.ior,p.sheen>0&&(m.sheenColor.value.copy(p.sheenColor).multiplyScalar(p.sheen),m.sheenRoughness.value=p.sheenRoughness,p.sheenColorMap&&(m.sheenColorMap.value=p.sheenColorMap,e(p.sheenColorMap,m.sheenColorMapTransform)),p.sheenRoughnessMap&&(m.sheenRoughnessMap.value=p.sheenRoughnessMap,e(p.sheenRoughnessMap,m.sheenRoughnessMapTransform))),p.clearcoat>0&&(m.clearcoat.value=p.clearcoat,m.clearcoatRoughness.value=p.clearcoatRoughness,p.clearcoatMap&&(m.clearcoatMap.value=p.clearcoatMap,e(p.clearcoatMap,m.clearcoatMapTransform)),p.clearcoatRoughnessMap&&(m.clearcoatRoughnessMap.value=p.clearcoatRoughnessMap,e(p.clearcoatRoughnessMap,m.clearcoatRoughnessMapTransform)),p.clearcoatNormalMap&&(m.clearcoatNormalMap.value=p.clearcoatNormalMap,e(p.clearcoatNormalMap,m.clearcoatNormalMapTransform),m.clearcoatNormalScale.value.copy(p.clearcoatNormalScale),p.side===Fn&&m.clearcoatNormalScale.value.negate())),p.dispersion>0&&(m.dispersion.value=p.dispersion),p.iridescence>0&&(m.iridescence.value=p.iridescence,m.iridescenceIOR.value=p.iridescenceIOR,m.iridescenceThicknessMinimum.value=p.iridescenceThicknessRange[0],m.iridescenceThicknessMaximum.value=p.iridescenceThicknessRange[1],p.iridescenceMap&&(m.iridescenceMap.value=p.iridescenceMap,e(p.iridescenceMap,m.iridescenceMapTransform)),p.iridescenceThicknessMap&&(m.iridescenceThicknessMap.value=p.iridescenceThicknessMap,e(p.iridescenceThicknessMap,m.iridescenceThicknessMapTransform))),p.transmission>0&&(m.transmission.value=p.transmission,m.transmissionSamplerMap.value=w.texture,m.transmissionSamplerSize.value.set(w.width,w.height),p.transmissionMap&&(m.transmissionMap.value=p.transmissionMap,e(p.transmissionMap,m.transmissionMapTransform)),m.thickness.value=p.thickness,p.thicknessMap&&(m.thicknessMap.value=p.thicknessMap,e(p.thicknessMap,m.thicknessMapTransform)),m.attenuationDistance.value=p.attenuationDistance,m.attenuationColor.value.copy(p.attenuationColor)),p.anisotropy>0&&(m.anisotropyVector.value.set(p.anisotropy*Math.cos(p.anisotropyRotation),p.anisotropy*Math.sin(p.anisotropyRotation)),p.anisotropyMap&&(m.anisotropyMap.value=p.anisotropyMap,e(p.anisotropyMap,m.anisotropyMapTransform))),m.specularIntensity.value=p.specularIntensity,m.specularColor.value.copy(p.specularColor),p.specularColorMap&&(m.specularColorMap.value=p.specularColorMap,e(p.specularColorMap,m.specularColorMapTransform)),p.specularIntensityMap&&(m.specularIntensityMap.value=p.specularIntensityMap,e(p.specularIntensityMap,m.specularIntensityMapTransform))}function g(m,p){p.matcap&&(m.matcap.value=p.matcap)}function x(m,p){let w=t.get(p).light;m.referencePosition.value.setFromMatrixPosition(w.matrixWorld),m.nearDistance.value=w.shadow.camera.near,m.farDistance.value=w.shadow.camera.far}return{refreshFogUniforms:n,refreshMaterialUniforms:s}}function xS(i,t,e,n){let s={},r={},o=[],a=i.getParameter(i.MAX_UNIFORM_BUFFER_BINDINGS);function c(w,E){let v=E.program;n.uniformBlockBinding(w,v)}function l(w,E){let v=s[w.id];v===void 0&&(g(w),v=h(w),s[w.id]=v,w.addEventListener("dispose",m));let C=E.program;n.updateUBOMapping(w,C);let A=t.render.frame;r[w.id]!==A&&(d(w),r[w.id]=A)}function h(w){let E=u();w.__bindingPointIndex=E;let v=i.createBuffer(),C=w.__size,A=w.usage;return i.bindBuffer(i.UNIFORM_BUFFER,v),i.bufferData(i.UNIFORM_BUFFER,C,A),i.bindBuffer(i.UNIFORM_BUFFER,null),i.bindBufferBase(i.UNIFORM_BUFFER,E,v),v}function u(){for(let w=0;w<a;w++)if(o.indexOf(w)===-1)return o.push(w),w;return console.error("THREE.WebGLRenderer: Maximum number of simultaneously usable uniforms groups reached."),0}function d(w){let E=s[w.id],v=w.uniforms,C=w.__cache;i.bindBuffer(i.UNIFORM_BUFFER,E);for(let A=0,D=v.length;A<D;A++){let U=Array.isArray(v[A])?v[A]:[v[A]];for(let S=0,b=U.length;S<b;S++){let P=U[S];if(f(P,A,S,C)===!0){let O=P.__offset,z=Array.isArray(P.value)?P.value:[P.value],W=0;for(let X=0;X<z.length;X++){let Y=z[X],j=x(Y);typeof Y=="number"||typeof Y=="boolean"?(P.__data[0]=Y,i.bufferSubData(i.UNIFORM_BUFFER,O+W,P.__data)):Y.isMatrix3?(P.__data[0]=Y.elements[0],P.__data[1]=Y.elements[1],P.__data[2]=Y.elements[2],P.__data[3]=0,P.__data[4]=Y.elements[3],P.__data[5]=Y.elements[4],P.__data[6]=Y.elements[5],P.__data[7]=0,P.__data[8]=Y.elements[6],P.__data[9]=Y.elements[7],P.__data[10]=Y.elements[8],P.__data[11]=0):(Y.toArray(P.__data,W),W+=j.storage/Float32Array.BYTES_PER_ELEMENT)}i.bufferSubData(i.UNIFORM_BUFFER,O,P.__data)}}}i.bindBuffer(i.UNIFORM_BUFFER,null)}function f(w,E,v,C){let A=w.value,D=E+"_"+v;if(C[D]===void 0)return typeof A=="number"||typeof A=="boolean"?C[D]=A:C[D]=A.clone(),!0;{let U=C[D];if(typeof A=="number"||typeof A=="boolean"){if(U!==A)return C[D]=A,!0}else if(U.equals(A)===!1)return U.copy(A),!0}return!1}function g(w){let E=w.uniforms,v=0,C=16;for(let D=0,U=E.length;D<U;D++){let S=Array.isArray(E[D])?E[D]:[E[D]];for(let b=0,P=S.length;b<P;b++){let O=S[b],z=Array.isArray(O.value)?O.value:[O.value];for(let W=0,X=z.length;W<X;W++){let Y=z[W],j=x(Y),K=v%C,at=K%j.boundary,lt=K+at;v+=at,lt!==0&&C-lt<j.storage&&(v+=C-lt),O.__data=new Float32Array(j.storage/Float32Array.BYTES_PER_ELEMENT),O.__offset=v,v+=j.storage}}}let A=v%C;return A>0&&(v+=C-A),w.__size=v,w.__cache={},this}function x(w){let E={boundary:0,storage:0};return typeof w=="number"||typeof w=="boolean"?(E.boundary=4,E.storage=4):w.isVector2?(E.boundary=8,E.storage=8):w.isVector3||w.isColor?(E.boundary=16,E.storage=12):w.isVector4?(E.boundary=16,E.storage=16):w.isMatrix3?(E.boundary=48,E.storage=48):w.isMatrix4?(E.boundary=64,E.storage=64):w.isTexture?console.warn("THREE.WebGLRenderer: Texture samplers can not be part of an uniforms group."):console.warn("THREE.WebGLRenderer: Unsupported uniform value type.",w),E}function m(w){let E=w.target;E.removeEventListener("dispose",m);let v=o.indexOf(E.__bindingPointIndex);o.splice(v,1),i.deleteBuffer(s[E.id]),delete s[E.id],delete r[E.id]}function p(){for(let w in s)i.deleteBuffer(s[w]);o=[],s={},r={}}return{bind:c,update:l,dispose:p}}var mc=class{constructor(t={}){let{canvas:e=om(),context:n=null,depth:s=!0,stencil:r=!1,alpha:o=!1,antialias:a=!1,premultipliedAlpha:c=!0,preserveDrawingBuffer:l=!1,powerPreference:h="default",failIfMajorPerformanceCaveat:u=!1,reversedDepthBuffer:d=!1}=t;this.isWebGLRenderer=!0;let f;if(n!==null){if(typeof WebGLRenderingContext<"u"&&n instanceof WebGLRenderingContext)throw new Error("THREE.WebGLRenderer: WebGL 1 is not supported since r163.");f=n.getContextAttributes().alpha}else f=o;let g=new Uint32Array(4),x=new Int32Array(4),m=null,p=null,w=[],E=[];this.domElement=e,this.debug={checkShaderErrors:!0,onShaderError:null},this.autoClear=!0,this.autoClearColor=!0,this.autoClearDepth=!0,this.autoClearStencil=!0,this.sortObjects=!0,this.clippingPlanes=[],this.localClippingEnabled=!1,this.toneMapping=ji,this.toneMappingExposure=1,this.transmissionResolutionScale=1;let v=this,C=!1;this._outputColorSpace=Nn;let A=0,D=0,U=null,S=-1,b=null,P=new Ze,O=new Ze,z=null,W=new jt(0),X=0,Y=e.width,j=e.height,K=1,at=null,lt=null,xt=new Ze(0,0,Y,j),Mt=new Ze(0,0,Y,j),_t=!1,ie=new Vo,Qt=!1,Q=!1,et=new Re,wt=new H,kt=new Ze,yt={background:null,fog:null,environment:null,overrideMaterial:null,isScene:!0},te=!1;function De(){return U===null?K:1}let N=n;function de(T,V){return e.getContext(T,V)}try{let T={alpha:!0,depth:s,stencil:r,antialias:a,premultipliedAlpha:c,preserveDrawingBuffer:l,powerPreference:h,failIfMajorPerformanceCaveat:u};if("setAttribute"in e&&e.setAttribute("data-engine",`three.js r${"180"}`),e.addEventListener("webglcontextlost",pt,!1),e.addEventListener("webglcontextrestored",Pt,!1),e.addEventListener("webglcontextcreationerror",ht,!1),N===null){let V="webgl2";if(N=de(V,T),N===null)throw de(V)?new Error("Error creating WebGL context with your selected attributes."):new Error("Error creating WebGL context.")}}catch(T){throw console.error("THREE.WebGLRenderer: "+T.message),T}let $t,Gt,Nt,be,Ct,Ht,Be,xe,I,y,F,Z,nt,tt,Ut,ut,It,At,ot,gt,Bt,Ot,vt,Kt;function B(){$t=new FM(N),$t.init(),Ot=new fS(N,$t),Gt=new CM(N,$t,t,Ot),Nt=new uS(N,$t),Gt.reversedDepthBuffer&&d&&Nt.buffers.depth.setReversed(!0),be=new kM(N),Ct=new jb,Ht=new dS(N,$t,Nt,Ct,Gt,Ot,be),Be=new IM(v),xe=new UM(v),I=new Xx(N),vt=new AM(N,I),y=new OM(N,I,be,vt),F=new VM(N,y,I,be),ot=new zM(N,Gt,Ht),ut=new PM(Ct),Z=new Kb(v,Be,xe,$t,Gt,vt,ut),nt=new _S(v,Ct),tt=new tS,Ut=new oS($t),At=new TM(v,Be,xe,Nt,F,f,c),It=new cS(v,F,Gt),Kt=new xS(N,be,Gt,Nt),gt=new RM(N,$t,be),Bt=new BM(N,$t,be),be.programs=Z.programs,v.capabilities=Gt,v.extensions=$t,v.properties=Ct,v.renderLists=tt,v.shadowMap=It,v.state=Nt,v.info=be}B();let dt=new Ru(v,N);this.xr=dt,this.getContext=function(){return N},this.getContextAttributes=function(){return N.getContextAttributes()},this.forceContextLoss=function(){let T=$t.get("WEBGL_lose_context");T&&T.loseContext()},this.forceContextRestore=function(){let T=$t.get("WEBGL_lose_context");T&&T.restoreContext()},this.getPixelRatio=function(){return K},this.setPixelRatio=function(T){T!==void 0&&(K=T,this.setSize(Y,j,!1))},this.getSize=function(T){return T.set(Y,j)},this.setSize=function(T,V,J=!0){if(dt.isPresenting){console.warn("THREE.WebGLRenderer: Can't change size while VR device is presenting.");return}Y=T,j=V,e.width=Math.floor(T*K),e.height=Math.floor(V*K),J===!0&&(e.style.width=T+"px",e.style.height=V+"px"),this.setViewport(0,0,T,V)},this.getDrawingBufferSize=function(T){return T.set(Y*K,j*K).floor()},this.setDrawingBufferSize=function(T,V,J){Y=T,j=V,K=J,e.width=Math.floor(T*J),e.height=Math.floor(V*J),this.setViewport(0,0,T,V)},this.getCurrentViewport=function(T){return T.copy(P)},this.getViewport=function(T){return T.copy(xt)},this.setViewport=function(T,V,J,$){T.isVector4?xt.set(T.x,T.y,T.z,T.w):xt.set(T,V,J,$),Nt.viewport(P.copy(xt).multiplyScalar(K).round())},this.getScissor=function(T){return T.copy(Mt)},this.setScissor=function(T,V,J,$){T.isVector4?Mt.set(T.x,T.y,T.z,T.w):Mt.set(T,V,J,$),Nt.scissor(O.copy(Mt).multiplyScalar(K).round())},this.getScissorTest=function(){return _t},this.setScissorTest=function(T){Nt.setScissorTest(_t=T)},this.setOpaqueSort=function(T){at=T},this.setTransparentSort=function(T){lt=T},this.getClearColor=function(T){return T.copy(At.getClearColor())},this.setClearColor=function(){At.setClearColor(...arguments)},this.getClearAlpha=function(){return At.getClearAlpha()},this.setClearAlpha=function(){At.setClearAlpha(...arguments)},this.clear=function(T=!0,V=!0,J=!0){let $=0;if(T){let G=!1;if(U!==null){let ft=U.texture.format;G=ft===Fl||ft===Ul||ft===Nl}if(G){let ft=U.texture.type,bt=ft===Ni||ft===As||ft===Zr||ft===Kr||ft===Il||ft===Ll,Lt=At.getClearColor(),Et=At.getClearAlpha(),Xt=Lt.r,qt=Lt.g,zt=Lt.b;bt?(g[0]=Xt,g[1]=qt,g[2]=zt,g[3]=Et,N.clearBufferuiv(N.COLOR,0,g)):(x[0]=Xt,x[1]=qt,x[2]=zt,x[3]=Et,N.clearBufferiv(N.COLOR,0,x))}else $|=N.COLOR_BUFFER_BIT}V&&($|=N.DEPTH_BUFFER_BIT),J&&($|=N.STENCIL_BUFFER_BIT,this.state.buffers.stencil.setMask(4294967295)),N.clear($)},this.clearColor=function(){this.clear(!0,!1,!1)},this.clearDepth=function(){this.clear(!1,!0,!1)},this.clearStencil=function(){this.clear(!1,!1,!0)},this.dispose=function(){e.removeEventListener("webglcontextlost",pt,!1),e.removeEventListener("webglcontextrestored",Pt,!1),e.removeEventListener("webglcontextcreationerror",ht,!1),At.dispose(),tt.dispose(),Ut.dispose(),Ct.dispose(),Be.dispose(),xe.dispose(),F.dispose(),vt.dispose(),Kt.dispose(),Z.dispose(),dt.dispose(),dt.removeEventListener("sessionstart",Pe),dt.removeEventListener("sessionend",Gn),On.stop()};function pt(T){T.preventDefault(),console.log("THREE.WebGLRenderer: Context Lost."),C=!0}function Pt(){console.log("THREE.WebGLRenderer: Context Restored."),C=!1;let T=be.autoReset,V=It.enabled,J=It.autoUpdate,$=It.needsUpdate,G=It.type;B(),be.autoReset=T,It.enabled=V,It.autoUpdate=J,It.needsUpdate=$,It.type=G}function ht(T){console.error("THREE.WebGLRenderer: A WebGL context could not be created. Reason: ",T.statusMessage)}function rt(T){let V=T.target;V.removeEventListener("dispose",rt),Ft(V)}function Ft(T){ee(T),Ct.remove(T)}function ee(T){let V=Ct.get(T).programs;V!==void 0&&(V.forEach(function(J){Z.releaseProgram(J)}),T.isShaderMaterial&&Z.releaseShaderCache(T))}this.renderBufferDirect=function(T,V,J,$,G,ft){V===null&&(V=yt);let bt=G.isMesh&&G.matrixWorld.determinant()<0,Lt=Oi(T,V,J,$,G);Nt.setMaterial($,bt);let Et=J.index,Xt=1;if($.wireframe===!0){if(Et=y.getWireframeAttribute(J),Et===void 0)return;Xt=2}let qt=J.drawRange,zt=J.attributes.position,oe=qt.start*Xt,me=(qt.start+qt.count)*Xt;ft!==null&&(oe=Math.max(oe,ft.start*Xt),me=Math.min(me,(ft.start+ft.count)*Xt)),Et!==null?(oe=Math.max(oe,0),me=Math.min(me,Et.count)):zt!=null&&(oe=Math.max(oe,0),me=Math.min(me,zt.count));let Ne=me-oe;if(Ne<0||Ne===1/0)return;vt.setup(G,$,Lt,J,Et);let Se,se=gt;if(Et!==null&&(Se=I.get(Et),se=Bt,se.setIndex(Se)),G.isMesh)$.wireframe===!0?(Nt.setLineWidth($.wireframeLinewidth*De()),se.setMode(N.LINES)):se.setMode(N.TRIANGLES);else if(G.isLine){let Wt=$.linewidth;Wt===void 0&&(Wt=1),Nt.setLineWidth(Wt*De()),G.isLineSegments?se.setMode(N.LINES):G.isLineLoop?se.setMode(N.LINE_LOOP):se.setMode(N.LINE_STRIP)}else G.isPoints?se.setMode(N.POINTS):G.isSprite&&se.setMode(N.TRIANGLES);if(G.isBatchedMesh)if(G._multiDrawInstances!==null)Gr("THREE.WebGLRenderer: renderMultiDrawInstances has been deprecated and will be removed in r184. Append to renderMultiDraw arguments and use indirection."),se.renderMultiDrawInstances(G._multiDrawStarts,G._multiDrawCounts,G._multiDrawCount,G._multiDrawInstances);else if($t.get("WEBGL_multi_draw"))se.renderMultiDraw(G._multiDrawStarts,G._multiDrawCounts,G._multiDrawCount);else{let Wt=G._multiDrawStarts,Ue=G._multiDrawCounts,he=G._multiDrawCount,Mn=Et?I.get(Et).bytesPerElement:1,es=Ct.get($).currentProgram.getUniforms();for(let An=0;An<he;An++)es.setValue(N,"_gl_DrawID",An),se.render(Wt[An]/Mn,Ue[An])}else if(G.isInstancedMesh)se.renderInstances(oe,Ne,G.count);else if(J.isInstancedBufferGeometry){let Wt=J._maxInstanceCount!==void 0?J._maxInstanceCount:1/0,Ue=Math.min(J.instanceCount,Wt);se.renderInstances(oe,Ne,Ue)}else se.render(oe,Ne)};function Te(T,V,J){T.transparent===!0&&T.side===Vn&&T.forceSinglePass===!1?(T.side=Fn,T.needsUpdate=!0,Rs(T,V,J),T.side=Zi,T.needsUpdate=!0,Rs(T,V,J),T.side=Vn):Rs(T,V,J)}this.compile=function(T,V,J=null){J===null&&(J=T),p=Ut.get(J),p.init(V),E.push(p),J.traverseVisible(function(G){G.isLight&&G.layers.test(V.layers)&&(p.pushLight(G),G.castShadow&&p.pushShadow(G))}),T!==J&&T.traverseVisible(function(G){G.isLight&&G.layers.test(V.layers)&&(p.pushLight(G),G.castShadow&&p.pushShadow(G))}),p.setupLights();let $=new Set;return T.traverse(function(G){if(!(G.isMesh||G.isPoints||G.isLine||G.isSprite))return;let ft=G.material;if(ft)if(Array.isArray(ft))for(let bt=0;bt<ft.length;bt++){let Lt=ft[bt];Te(Lt,J,G),$.add(Lt)}else Te(ft,J,G),$.add(ft)}),p=E.pop(),$},this.compileAsync=function(T,V,J=null){let $=this.compile(T,V,J);return new Promise(G=>{function ft(){if($.forEach(function(bt){Ct.get(bt).currentProgram.isReady()&&$.delete(bt)}),$.size===0){G(T);return}setTimeout(ft,10)}$t.get("KHR_parallel_shader_compile")!==null?ft():setTimeout(ft,10)})};let pe=null;function xn(T){pe&&pe(T)}function Pe(){On.stop()}function Gn(){On.start()}let On=new Nm;On.setAnimationLoop(xn),typeof self<"u"&&On.setContext(self),this.setAnimationLoop=function(T){pe=T,dt.setAnimationLoop(T),T===null?On.stop():On.start()},dt.addEventListener("sessionstart",Pe),dt.addEventListener("sessionend",Gn),this.render=function(T,V){if(V!==void 0&&V.isCamera!==!0){console.error("THREE.WebGLRenderer.render: camera is not an instance of THREE.Camera.");return}if(C===!0)return;if(T.matrixWorldAutoUpdate===!0&&T.updateMatrixWorld(),V.parent===null&&V.matrixWorldAutoUpdate===!0&&V.updateMatrixWorld(),dt.enabled===!0&&dt.isPresenting===!0&&(dt.cameraAutoUpdate===!0&&dt.updateCamera(V),V=dt.getCamera()),T.isScene===!0&&T.onBeforeRender(v,T,V,U),p=Ut.get(T,E.length),p.init(V),E.push(p),et.multiplyMatrices(V.projectionMatrix,V.matrixWorldInverse),ie.setFromProjectionMatrix(et,vi,V.reversedDepth),Q=this.localClippingEnabled,Qt=ut.init(this.clippingPlanes,Q),m=tt.get(T,w.length),m.init(),w.push(m),dt.enabled===!0&&dt.isPresenting===!0){let ft=v.xr.getDepthSensingMesh();ft!==null&&Si(ft,V,-1/0,v.sortObjects)}Si(T,V,0,v.sortObjects),m.finish(),v.sortObjects===!0&&m.sort(at,lt),te=dt.enabled===!1||dt.isPresenting===!1||dt.hasDepthSensing()===!1,te&&At.addToRenderList(m,T),this.info.render.frame++,Qt===!0&&ut.beginShadows();let J=p.state.shadowsArray;It.render(J,T,V),Qt===!0&&ut.endShadows(),this.info.autoReset===!0&&this.info.reset();let $=m.opaque,G=m.transmissive;if(p.setupLights(),V.isArrayCamera){let ft=V.cameras;if(G.length>0)for(let bt=0,Lt=ft.length;bt<Lt;bt++){let Et=ft[bt];Fi($,G,T,Et)}te&&At.render(T);for(let bt=0,Lt=ft.length;bt<Lt;bt++){let Et=ft[bt];Tn(m,T,Et,Et.viewport)}}else G.length>0&&Fi($,G,T,V),te&&At.render(T),Tn(m,T,V);U!==null&&D===0&&(Ht.updateMultisampleRenderTarget(U),Ht.updateRenderTargetMipmap(U)),T.isScene===!0&&T.onAfterRender(v,T,V),vt.resetDefaultState(),S=-1,b=null,E.pop(),E.length>0?(p=E[E.length-1],Qt===!0&&ut.setGlobalState(v.clippingPlanes,p.state.camera)):p=null,w.pop(),w.length>0?m=w[w.length-1]:m=null};function Si(T,V,J,$){if(T.visible===!1)return;if(T.layers.test(V.layers)){if(T.isGroup)J=T.renderOrder;else if(T.isLOD)T.autoUpdate===!0&&T.update(V);else if(T.isLight)p.pushLight(T),T.castShadow&&p.pushShadow(T);else if(T.isSprite){if(!T.frustumCulled||ie.intersectsSprite(T)){$&&kt.setFromMatrixPosition(T.matrixWorld).applyMatrix4(et);let bt=F.update(T),Lt=T.material;Lt.visible&&m.push(T,bt,Lt,J,kt.z,null)}}else if((T.isMesh||T.isLine||T.isPoints)&&(!T.frustumCulled||ie.intersectsObject(T))){let bt=F.update(T),Lt=T.material;if($&&(T.boundingSphere!==void 0?(T.boundingSphere===null&&T.computeBoundingSphere(),kt.copy(T.boundingSphere.center)):(bt.boundingSphere===null&&bt.computeBoundingSphere(),kt.copy(bt.boundingSphere.center)),kt.applyMatrix4(T.matrixWorld).applyMatrix4(et)),Array.isArray(Lt)){let Et=bt.groups;for(let Xt=0,qt=Et.length;Xt<qt;Xt++){let zt=Et[Xt],oe=Lt[zt.materialIndex];oe&&oe.visible&&m.push(T,bt,oe,J,kt.z,zt)}}else Lt.visible&&m.push(T,bt,Lt,J,kt.z,null)}}let ft=T.children;for(let bt=0,Lt=ft.length;bt<Lt;bt++)Si(ft[bt],V,J,$)}function Tn(T,V,J,$){let G=T.opaque,ft=T.transmissive,bt=T.transparent;p.setupLightsView(J),Qt===!0&&ut.setGlobalState(v.clippingPlanes,J),$&&Nt.viewport(P.copy($)),G.length>0&&ci(G,V,J),ft.length>0&&ci(ft,V,J),bt.length>0&&ci(bt,V,J),Nt.buffers.depth.setTest(!0),Nt.buffers.depth.setMask(!0),Nt.buffers.color.setMask(!0),Nt.setPolygonOffset(!1)}function Fi(T,V,J,$){if((J.isScene===!0?J.overrideMaterial:null)!==null)return;p.state.transmissionRenderTarget[$.id]===void 0&&(p.state.transmissionRenderTarget[$.id]=new Ii(1,1,{generateMipmaps:!0,type:$t.has("EXT_color_buffer_half_float")||$t.has("EXT_color_buffer_float")?Jr:Ni,minFilter:Ts,samples:4,stencilBuffer:r,resolveDepthBuffer:!1,resolveStencilBuffer:!1,colorSpace:fe.workingColorSpace}));let ft=p.state.transmissionRenderTarget[$.id],bt=$.viewport||P;ft.setSize(bt.z*v.transmissionResolutionScale,bt.w*v.transmissionResolutionScale);let Lt=v.getRenderTarget(),Et=v.getActiveCubeFace(),Xt=v.getActiveMipmapLevel();v.setRenderTarget(ft),v.getClearColor(W),X=v.getClearAlpha(),X<1&&v.setClearColor(16777215,.5),v.clear(),te&&At.render(J);let qt=v.toneMapping;v.toneMapping=ji;let zt=$.viewport;if($.viewport!==void 0&&($.viewport=void 0),p.setupLightsView($),Qt===!0&&ut.setGlobalState(v.clippingPlanes,$),ci(T,J,$),Ht.updateMultisampleRenderTarget(ft),Ht.updateRenderTargetMipmap(ft),$t.has("WEBGL_multisampled_render_to_texture")===!1){let oe=!1;for(let me=0,Ne=V.length;me<Ne;me++){let Se=V[me],se=Se.object,Wt=Se.geometry,Ue=Se.material,he=Se.group;if(Ue.side===Vn&&se.layers.test($.layers)){let Mn=Ue.side;Ue.side=Fn,Ue.needsUpdate=!0,oo(se,J,$,Wt,Ue,he),Ue.side=Mn,Ue.needsUpdate=!0,oe=!0}}oe===!0&&(Ht.updateMultisampleRenderTarget(ft),Ht.updateRenderTargetMipmap(ft))}v.setRenderTarget(Lt,Et,Xt),v.setClearColor(W,X),zt!==void 0&&($.viewport=zt),v.toneMapping=qt}function ci(T,V,J){let $=V.isScene===!0?V.overrideMaterial:null;for(let G=0,ft=T.length;G<ft;G++){let bt=T[G],Lt=bt.object,Et=bt.geometry,Xt=bt.group,qt=bt.material;qt.allowOverride===!0&&$!==null&&(qt=$),Lt.layers.test(J.layers)&&oo(Lt,V,J,Et,qt,Xt)}}function oo(T,V,J,$,G,ft){T.onBeforeRender(v,V,J,$,G,ft),T.modelViewMatrix.multiplyMatrices(J.matrixWorldInverse,T.matrixWorld),T.normalMatrix.getNormalMatrix(T.modelViewMatrix),G.onBeforeRender(v,V,J,$,T,ft),G.transparent===!0&&G.side===Vn&&G.forceSinglePass===!1?(G.side=Fn,G.needsUpdate=!0,v.renderBufferDirect(J,V,$,G,T,ft),G.side=Zi,G.needsUpdate=!0,v.renderBufferDirect(J,V,$,G,T,ft),G.side=Vn):v.renderBufferDirect(J,V,$,G,T,ft),T.onAfterRender(v,V,J,$,G,ft)}function Rs(T,V,J){V.isScene!==!0&&(V=yt);let $=Ct.get(T),G=p.state.lights,ft=p.state.shadowsArray,bt=G.state.version,Lt=Z.getParameters(T,G.state,ft,V,J),Et=Z.getProgramCacheKey(Lt),Xt=$.programs;$.environment=T.isMeshStandardMaterial?V.environment:null,$.fog=V.fog,$.envMap=(T.isMeshStandardMaterial?xe:Be).get(T.envMap||$.environment),$.envMapRotation=$.environment!==null&&T.envMap===null?V.environmentRotation:T.envMapRotation,Xt===void 0&&(T.addEventListener("dispose",rt),Xt=new Map,$.programs=Xt);let qt=Xt.get(Et);if(qt!==void 0){if($.currentProgram===qt&&$.lightsStateVersion===bt)return ra(T,Lt),qt}else Lt.uniforms=Z.getUniforms(T),T.onBeforeCompile(Lt,v),qt=Z.acquireProgram(Lt,Et),Xt.set(Et,qt),$.uniforms=Lt.uniforms;let zt=$.uniforms;return(!T.isShaderMaterial&&!T.isRawShaderMaterial||T.clipping===!0)&&(zt.clippingPlanes=ut.uniform),ra(T,Lt),$.needsLights=Cs(T),$.lightsStateVersion=bt,$.needsLights&&(zt.ambientLightColor.value=G.state.ambient,zt.lightProbe.value=G.state.probe,zt.directionalLights.value=G.state.directional,zt.directionalLightShadows.value=G.state.directionalShadow,zt.spotLights.value=G.state.spot,zt.spotLightShadows.value=G.state.spotShadow,zt.rectAreaLights.value=G.state.rectArea,zt.ltc_1.value=G.state.rectAreaLTC1,zt.ltc_2.value=G.state.rectAreaLTC2,zt.pointLights.value=G.state.point,zt.pointLightShadows.value=G.state.pointShadow,zt.hemisphereLights.value=G.state.hemi,zt.directionalShadowMap.value=G.state.directionalShadowMap,zt.directionalShadowMatrix.value=G.state.directionalShadowMatrix,zt.spotShadowMap.value=G.state.spotShadowMap,zt.spotLightMatrix.value=G.state.spotLightMatrix,zt.spotLightMap.value=G.state.spotLightMap,zt.pointShadowMap.value=G.state.pointShadowMap,zt.pointShadowMatrix.value=G.state.pointShadowMatrix),$.currentProgram=qt,$.uniformsList=null,qt}function sa(T){if(T.uniformsList===null){let V=T.currentProgram.getUniforms();T.uniformsList=eo.seqWithValue(V.seq,T.uniforms)}return T.uniformsList}function ra(T,V){let J=Ct.get(T);J.outputColorSpace=V.outputColorSpace,J.batching=V.batching,J.batchingColor=V.batchingColor,J.instancing=V.instancing,J.instancingColor=V.instancingColor,J.instancingMorph=V.instancingMorph,J.skinning=V.skinning,J.morphTargets=V.morphTargets,J.morphNormals=V.morphNormals,J.morphColors=V.morphColors,J.morphTargetsCount=V.morphTargetsCount,J.numClippingPlanes=V.numClippingPlanes,J.numIntersection=V.numClipIntersection,J.vertexAlphas=V.vertexAlphas,J.vertexTangents=V.vertexTangents,J.toneMapping=V.toneMapping}function Oi(T,V,J,$,G){V.isScene!==!0&&(V=yt),Ht.resetTextureUnits();let ft=V.fog,bt=$.isMeshStandardMaterial?V.environment:null,Lt=U===null?v.outputColorSpace:U.isXRRenderTarget===!0?U.texture.colorSpace:$s,Et=($.isMeshStandardMaterial?xe:Be).get($.envMap||bt),Xt=$.vertexColors===!0&&!!J.attributes.color&&J.attributes.color.itemSize===4,qt=!!J.attributes.tangent&&(!!$.normalMap||$.anisotropy>0),zt=!!J.morphAttributes.position,oe=!!J.morphAttributes.normal,me=!!J.morphAttributes.color,Ne=ji;$.toneMapped&&(U===null||U.isXRRenderTarget===!0)&&(Ne=v.toneMapping);let Se=J.morphAttributes.position||J.morphAttributes.normal||J.morphAttributes.color,se=Se!==void 0?Se.length:0,Wt=Ct.get($),Ue=p.state.lights;if(Qt===!0&&(Q===!0||T!==b)){let hn=T===b&&$.id===S;ut.setState($,T,hn)}let he=!1;$.version===Wt.__version?(Wt.needsLights&&Wt.lightsStateVersion!==Ue.state.version||Wt.outputColorSpace!==Lt||G.isBatchedMesh&&Wt.batching===!1||!G.isBatchedMesh&&Wt.batching===!0||G.isBatchedMesh&&Wt.batchingColor===!0&&G.colorTexture===null||G.isBatchedMesh&&Wt.batchingColor===!1&&G.colorTexture!==null||G.isInstancedMesh&&Wt.instancing===!1||!G.isInstancedMesh&&Wt.instancing===!0||G.isSkinnedMesh&&Wt.skinning===!1||!G.isSkinnedMesh&&Wt.skinning===!0||G.isInstancedMesh&&Wt.instancingColor===!0&&G.instanceColor===null||G.isInstancedMesh&&Wt.instancingColor===!1&&G.instanceColor!==null||G.isInstancedMesh&&Wt.instancingMorph===!0&&G.morphTexture===null||G.isInstancedMesh&&Wt.instancingMorph===!1&&G.morphTexture!==null||Wt.envMap!==Et||$.fog===!0&&Wt.fog!==ft||Wt.numClippingPlanes!==void 0&&(Wt.numClippingPlanes!==ut.numPlanes||Wt.numIntersection!==ut.numIntersection)||Wt.vertexAlphas!==Xt||Wt.vertexTangents!==qt||Wt.morphTargets!==zt||Wt.morphNormals!==oe||Wt.morphColors!==me||Wt.toneMapping!==Ne||Wt.morphTargetsCount!==se)&&(he=!0):(he=!0,Wt.__version=$.version);let Mn=Wt.currentProgram;he===!0&&(Mn=Rs($,V,G));let es=!1,An=!1,Ps=!1,Fe=Mn.getUniforms(),Rn=Wt.uniforms;if(Nt.useProgram(Mn.program)&&(es=!0,An=!0,Ps=!0),$.id!==S&&(S=$.id,An=!0),es||b!==T){Nt.buffers.depth.getReversed()&&T.reversedDepth!==!0&&(T._reversedDepth=!0,T.updateProjectionMatrix()),Fe.setValue(N,"projectionMatrix",T.projectionMatrix),Fe.setValue(N,"viewMatrix",T.matrixWorldInverse);let un=Fe.map.cameraPosition;un!==void 0&&un.setValue(N,wt.setFromMatrixPosition(T.matrixWorld)),Gt.logarithmicDepthBuffer&&Fe.setValue(N,"logDepthBufFC",2/(Math.log(T.far+1)/Math.LN2)),($.isMeshPhongMaterial||$.isMeshToonMaterial||$.isMeshLambertMaterial||$.isMeshBasicMaterial||$.isMeshStandardMaterial||$.isShaderMaterial)&&Fe.setValue(N,"isOrthographic",T.isOrthographicCamera===!0),b!==T&&(b=T,An=!0,Ps=!0)}if(G.isSkinnedMesh){Fe.setOptional(N,G,"bindMatrix"),Fe.setOptional(N,G,"bindMatrixInverse");let hn=G.skeleton;hn&&(hn.boneTexture===null&&hn.computeBoneTexture(),Fe.setValue(N,"boneTexture",hn.boneTexture,Ht))}G.isBatchedMesh&&(Fe.setOptional(N,G,"batchingTexture"),Fe.setValue(N,"batchingTexture",G._matricesTexture,Ht),Fe.setOptional(N,G,"batchingIdTexture"),Fe.setValue(N,"batchingIdTexture",G._indirectTexture,Ht),Fe.setOptional(N,G,"batchingColorTexture"),G._colorsTexture!==null&&Fe.setValue(N,"batchingColorTexture",G._colorsTexture,Ht));let Bn=J.morphAttributes;if((Bn.position!==void 0||Bn.normal!==void 0||Bn.color!==void 0)&&ot.update(G,J,Mn),(An||Wt.receiveShadow!==G.receiveShadow)&&(Wt.receiveShadow=G.receiveShadow,Fe.setValue(N,"receiveShadow",G.receiveShadow)),$.isMeshGouraudMaterial&&$.envMap!==null&&(Rn.envMap.value=Et,Rn.flipEnvMap.value=Et.isCubeTexture&&Et.isRenderTargetTexture===!1?-1:1),$.isMeshStandardMaterial&&$.envMap===null&&V.environment!==null&&(Rn.envMapIntensity.value=V.environmentIntensity),An&&(Fe.setValue(N,"toneMappingExposure",v.toneMappingExposure),Wt.needsLights&&wc(Rn,Ps),ft&&$.fog===!0&&nt.refreshFogUniforms(Rn,ft),nt.refreshMaterialUniforms(Rn,$,K,j,p.state.transmissionRenderTarget[T.id]),eo.upload(N,sa(Wt),Rn,Ht)),$.isShaderMaterial&&$.uniformsNeedUpdate===!0&&(eo.upload(N,sa(Wt),Rn,Ht),$.uniformsNeedUpdate=!1),$.isSpriteMaterial&&Fe.setValue(N,"center",G.center),Fe.setValue(N,"modelViewMatrix",G.modelViewMatrix),Fe.setValue(N,"normalMatrix",G.normalMatrix),Fe.setValue(N,"modelMatrix",G.matrixWorld),$.isShaderMaterial||$.isRawShaderMaterial){let hn=$.uniformsGroups;for(let un=0,ns=hn.length;un<ns;un++){let Qn=hn[un];Kt.update(Qn,Mn),Kt.bind(Qn,Mn)}}return Mn}function wc(T,V){T.ambientLightColor.needsUpdate=V,T.lightProbe.needsUpdate=V,T.directionalLights.needsUpdate=V,T.directionalLightShadows.needsUpdate=V,T.pointLights.needsUpdate=V,T.pointLightShadows.needsUpdate=V,T.spotLights.needsUpdate=V,T.spotLightShadows.needsUpdate=V,T.rectAreaLights.needsUpdate=V,T.hemisphereLights.needsUpdate=V}function Cs(T){return T.isMeshLambertMaterial||T.isMeshToonMaterial||T.isMeshPhongMaterial||T.isMeshStandardMaterial||T.isShadowMaterial||T.isShaderMaterial&&T.lights===!0}this.getActiveCubeFace=function(){return A},this.getActiveMipmapLevel=function(){return D},this.getRenderTarget=function(){return U},this.setRenderTargetTextures=function(T,V,J){let $=Ct.get(T);$.__autoAllocateDepthBuffer=T.resolveDepthBuffer===!1,$.__autoAllocateDepthBuffer===!1&&($.__useRenderToTexture=!1),Ct.get(T.texture).__webglTexture=V,Ct.get(T.depthTexture).__webglTexture=$.__autoAllocateDepthBuffer?void 0:J,$.__hasExternalTextures=!0},this.setRenderTargetFramebuffer=function(T,V){let J=Ct.get(T);J.__webglFramebuffer=V,J.__useDefaultFramebuffer=V===void 0};let oa=N.createFramebuffer();this.setRenderTarget=function(T,V=0,J=0){U=T,A=V,D=J;let $=!0,G=null,ft=!1,bt=!1;if(T){let Et=Ct.get(T);if(Et.__useDefaultFramebuffer!==void 0)Nt.bindFramebuffer(N.FRAMEBUFFER,null),$=!1;else if(Et.__webglFramebuffer===void 0)Ht.setupRenderTarget(T);else if(Et.__hasExternalTextures)Ht.rebindTextures(T,Ct.get(T.texture).__webglTexture,Ct.get(T.depthTexture).__webglTexture);else if(T.depthBuffer){let zt=T.depthTexture;if(Et.__boundDepthTexture!==zt){if(zt!==null&&Ct.has(zt)&&(T.width!==zt.image.width||T.height!==zt.image.height))throw new Error("WebGLRenderTarget: Attached DepthTexture is initialized to the incorrect size.");Ht.setupDepthRenderbuffer(T)}}let Xt=T.texture;(Xt.isData3DTexture||Xt.isDataArrayTexture||Xt.isCompressedArrayTexture)&&(bt=!0);let qt=Ct.get(T).__webglFramebuffer;T.isWebGLCubeRenderTarget?(Array.isArray(qt[V])?G=qt[V][J]:G=qt[V],ft=!0):T.samples>0&&Ht.useMultisampledRTT(T)===!1?G=Ct.get(T).__webglMultisampledFramebuffer:Array.isArray(qt)?G=qt[J]:G=qt,P.copy(T.viewport),O.copy(T.scissor),z=T.scissorTest}else P.copy(xt).multiplyScalar(K).floor(),O.copy(Mt).multiplyScalar(K).floor(),z=_t;if(J!==0&&(G=oa),Nt.bindFramebuffer(N.FRAMEBUFFER,G)&&$&&Nt.drawBuffers(T,G),Nt.viewport(P),Nt.scissor(O),Nt.setScissorTest(z),ft){let Et=Ct.get(T.texture);N.framebufferTexture2D(N.FRAMEBUFFER,N.COLOR_ATTACHMENT0,N.TEXTURE_CUBE_MAP_POSITIVE_X+V,Et.__webglTexture,J)}else if(bt){let Et=V;for(let Xt=0;Xt<T.textures.length;Xt++){let qt=Ct.get(T.textures[Xt]);N.framebufferTextureLayer(N.FRAMEBUFFER,N.COLOR_ATTACHMENT0+Xt,qt.__webglTexture,J,Et)}}else if(T!==null&&J!==0){let Et=Ct.get(T.texture);N.framebufferTexture2D(N.FRAMEBUFFER,N.COLOR_ATTACHMENT0,N.TEXTURE_2D,Et.__webglTexture,J)}S=-1},this.readRenderTargetPixels=function(T,V,J,$,G,ft,bt,Lt=0){if(!(T&&T.isWebGLRenderTarget)){console.error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");return}let Et=Ct.get(T).__webglFramebuffer;if(T.isWebGLCubeRenderTarget&&bt!==void 0&&(Et=Et[bt]),Et){Nt.bindFramebuffer(N.FRAMEBUFFER,Et);try{let Xt=T.textures[Lt],qt=Xt.format,zt=Xt.type;if(!Gt.textureFormatReadable(qt)){console.error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not in RGBA or implementation defined format.");return}if(!Gt.textureTypeReadable(zt)){console.error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not in UnsignedByteType or implementation defined type.");return}V>=0&&V<=T.width-$&&J>=0&&J<=T.height-G&&(T.textures.length>1&&N.readBuffer(N.COLOR_ATTACHMENT0+Lt),N.readPixels(V,J,$,G,Ot.convert(qt),Ot.convert(zt),ft))}finally{let Xt=U!==null?Ct.get(U).__webglFramebuffer:null;Nt.bindFramebuffer(N.FRAMEBUFFER,Xt)}}},this.readRenderTargetPixelsAsync=async function(T,V,J,$,G,ft,bt,Lt=0){if(!(T&&T.isWebGLRenderTarget))throw new Error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");let Et=Ct.get(T).__webglFramebuffer;if(T.isWebGLCubeRenderTarget&&bt!==void 0&&(Et=Et[bt]),Et)if(V>=0&&V<=T.width-$&&J>=0&&J<=T.height-G){Nt.bindFramebuffer(N.FRAMEBUFFER,Et);let Xt=T.textures[Lt],qt=Xt.format,zt=Xt.type;if(!Gt.textureFormatReadable(qt))throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in RGBA or implementation defined format.");if(!Gt.textureTypeReadable(zt))throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in UnsignedByteType or implementation defined type.");let oe=N.createBuffer();N.bindBuffer(N.PIXEL_PACK_BUFFER,oe),N.bufferData(N.PIXEL_PACK_BUFFER,ft.byteLength,N.STREAM_READ),T.textures.length>1&&N.readBuffer(N.COLOR_ATTACHMENT0+Lt),N.readPixels(V,J,$,G,Ot.convert(qt),Ot.convert(zt),0);let me=U!==null?Ct.get(U).__webglFramebuffer:null;Nt.bindFramebuffer(N.FRAMEBUFFER,me);let Ne=N.fenceSync(N.SYNC_GPU_COMMANDS_COMPLETE,0);return N.flush(),await am(N,Ne,4),N.bindBuffer(N.PIXEL_PACK_BUFFER,oe),N.getBufferSubData(N.PIXEL_PACK_BUFFER,0,ft),N.deleteBuffer(oe),N.deleteSync(Ne),ft}else throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: requested read bounds are out of range.")},this.copyFramebufferToTexture=function(T,V=null,J=0){let $=Math.pow(2,-J),G=Math.floor(T.image.width*$),ft=Math.floor(T.image.height*$),bt=V!==null?V.x:0,Lt=V!==null?V.y:0;Ht.setTexture2D(T,0),N.copyTexSubImage2D(N.TEXTURE_2D,J,0,0,bt,Lt,G,ft),Nt.unbindTexture()};let wi=N.createFramebuffer(),en=N.createFramebuffer();this.copyTextureToTexture=function(T,V,J=null,$=null,G=0,ft=null){ft===null&&(G!==0?(Gr("WebGLRenderer: copyTextureToTexture function signature has changed to support src and dst mipmap levels."),ft=G,G=0):ft=0);let bt,Lt,Et,Xt,qt,zt,oe,me,Ne,Se=T.isCompressedTexture?T.mipmaps[ft]:T.image;if(J!==null)bt=J.max.x-J.min.x,Lt=J.max.y-J.min.y,Et=J.isBox3?J.max.z-J.min.z:1,Xt=J.min.x,qt=J.min.y,zt=J.isBox3?J.min.z:0;else{let Bn=Math.pow(2,-G);bt=Math.floor(Se.width*Bn),Lt=Math.floor(Se.height*Bn),T.isDataArrayTexture?Et=Se.depth:T.isData3DTexture?Et=Math.floor(Se.depth*Bn):Et=1,Xt=0,qt=0,zt=0}$!==null?(oe=$.x,me=$.y,Ne=$.z):(oe=0,me=0,Ne=0);let se=Ot.convert(V.format),Wt=Ot.convert(V.type),Ue;V.isData3DTexture?(Ht.setTexture3D(V,0),Ue=N.TEXTURE_3D):V.isDataArrayTexture||V.isCompressedArrayTexture?(Ht.setTexture2DArray(V,0),Ue=N.TEXTURE_2D_ARRAY):(Ht.setTexture2D(V,0),Ue=N.TEXTURE_2D),N.pixelStorei(N.UNPACK_FLIP_Y_WEBGL,V.flipY),N.pixelStorei(N.UNPACK_PREMULTIPLY_ALPHA_WEBGL,V.premultiplyAlpha),N.pixelStorei(N.UNPACK_ALIGNMENT,V.unpackAlignment);let he=N.getParameter(N.UNPACK_ROW_LENGTH),Mn=N.getParameter(N.UNPACK_IMAGE_HEIGHT),es=N.getParameter(N.UNPACK_SKIP_PIXELS),An=N.getParameter(N.UNPACK_SKIP_ROWS),Ps=N.getParameter(N.UNPACK_SKIP_IMAGES);N.pixelStorei(N.UNPACK_ROW_LENGTH,Se.width),N.pixelStorei(N.UNPACK_IMAGE_HEIGHT,Se.height),N.pixelStorei(N.UNPACK_SKIP_PIXELS,Xt),N.pixelStorei(N.UNPACK_SKIP_ROWS,qt),N.pixelStorei(N.UNPACK_SKIP_IMAGES,zt);let Fe=T.isDataArrayTexture||T.isData3DTexture,Rn=V.isDataArrayTexture||V.isData3DTexture;if(T.isDepthTexture){let Bn=Ct.get(T),hn=Ct.get(V),un=Ct.get(Bn.__renderTarget),ns=Ct.get(hn.__renderTarget);Nt.bindFramebuffer(N.READ_FRAMEBUFFER,un.__webglFramebuffer),Nt.bindFramebuffer(N.DRAW_FRAMEBUFFER,ns.__webglFramebuffer);for(let Qn=0;Qn<Et;Qn++)Fe&&(N.framebufferTextureLayer(N.READ_FRAMEBUFFER,N.COLOR_ATTACHMENT0,Ct.get(T).__webglTexture,G,zt+Qn),N.framebufferTextureLayer(N.DRAW_FRAMEBUFFER,N.COLOR_ATTACHMENT0,Ct.get(V).__webglTexture,ft,Ne+Qn)),N.blitFramebuffer(Xt,qt,bt,Lt,oe,me,bt,Lt,N.DEPTH_BUFFER_BIT,N.NEAREST);Nt.bindFramebuffer(N.READ_FRAMEBUFFER,null),Nt.bindFramebuffer(N.DRAW_FRAMEBUFFER,null)}else if(G!==0||T.isRenderTargetTexture||Ct.has(T)){let Bn=Ct.get(T),hn=Ct.get(V);Nt.bindFramebuffer(N.READ_FRAMEBUFFER,wi),Nt.bindFramebuffer(N.DRAW_FRAMEBUFFER,en);for(let un=0;un<Et;un++)Fe?N.framebufferTextureLayer(N.READ_FRAMEBUFFER,N.COLOR_ATTACHMENT0,Bn.__webglTexture,G,zt+un):N.framebufferTexture2D(N.READ_FRAMEBUFFER,N.COLOR_ATTACHMENT0,N.TEXTURE_2D,Bn.__webglTexture,G),Rn?N.framebufferTextureLayer(N.DRAW_FRAMEBUFFER,N.COLOR_ATTACHMENT0,hn.__webglTexture,ft,Ne+un):N.framebufferTexture2D(N.DRAW_FRAMEBUFFER,N.COLOR_ATTACHMENT0,N.TEXTURE_2D,hn.__webglTexture,ft),G!==0?N.blitFramebuffer(Xt,qt,bt,Lt,oe,me,bt,Lt,N.COLOR_BUFFER_BIT,N.NEAREST):Rn?N.copyTexSubImage3D(Ue,ft,oe,me,Ne+un,Xt,qt,bt,Lt):N.copyTexSubImage2D(Ue,ft,oe,me,Xt,qt,bt,Lt);Nt.bindFramebuffer(N.READ_FRAMEBUFFER,null),Nt.bindFramebuffer(N.DRAW_FRAMEBUFFER,null)}else Rn?T.isDataTexture||T.isData3DTexture?N.texSubImage3D(Ue,ft,oe,me,Ne,bt,Lt,Et,se,Wt,Se.data):V.isCompressedArrayTexture?N.compressedTexSubImage3D(Ue,ft,oe,me,Ne,bt,Lt,Et,se,Se.data):N.texSubImage3D(Ue,ft,oe,me,Ne,bt,Lt,Et,se,Wt,Se):T.isDataTexture?N.texSubImage2D(N.TEXTURE_2D,ft,oe,me,bt,Lt,se,Wt,Se.data):T.isCompressedTexture?N.compressedTexSubImage2D(N.TEXTURE_2D,ft,oe,me,Se.width,Se.height,se,Se.data):N.texSubImage2D(N.TEXTURE_2D,ft,oe,me,bt,Lt,se,Wt,Se);N.pixelStorei(N.UNPACK_ROW_LENGTH,he),N.pixelStorei(N.UNPACK_IMAGE_HEIGHT,Mn),N.pixelStorei(N.UNPACK_SKIP_PIXELS,es),N.pixelStorei(N.UNPACK_SKIP_ROWS,An),N.pixelStorei(N.UNPACK_SKIP_IMAGES,Ps),ft===0&&V.generateMipmaps&&N.generateMipmap(Ue),Nt.unbindTexture()},this.initRenderTarget=function(T){Ct.get(T).__webglFramebuffer===void 0&&Ht.setupRenderTarget(T)},this.initTexture=function(T){T.isCubeTexture?Ht.setTextureCube(T,0):T.isData3DTexture?Ht.setTexture3D(T,0):T.isDataArrayTexture||T.isCompressedArrayTexture?Ht.setTexture2DArray(T,0):Ht.setTexture2D(T,0),Nt.unbindTexture()},this.resetState=function(){A=0,D=0,U=null,Nt.reset(),vt.reset()},typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}get coordinateSystem(){return vi}get outputColorSpace(){return this._outputColorSpace}set outputColorSpace(t){this._outputColorSpace=t;let e=this.getContext();e.drawingBufferColorSpace=fe._getDrawingBufferColorSpace(t),e.unpackColorSpace=fe._getUnpackColorSpace()}};var km={type:"change"},Iu={type:"start"},Vm={type:"end"},_c=new Xr,zm=new ri,yS=Math.cos(70*cu.DEG2RAD),cn=new H,Hn=2*Math.PI,Ce={NONE:-1,ROTATE:0,DOLLY:1,PAN:2,TOUCH_ROTATE:3,TOUCH_PAN:4,TOUCH_DOLLY_PAN:5,TOUCH_DOLLY_ROTATE:6},Pu=1e-6,xc=class extends $o{constructor(t,e=null){super(t,e),this.state=Ce.NONE,this.target=new H,this.cursor=new H,this.minDistance=0,this.maxDistance=1/0,this.minZoom=0,this.maxZoom=1/0,this.minTargetRadius=0,this.maxTargetRadius=1/0,this.minPolarAngle=0,this.maxPolarAngle=Math.PI,this.minAzimuthAngle=-1/0,this.maxAzimuthAngle=1/0,this.enableDamping=!1,this.dampingFactor=.05,this.enableZoom=!0,this.zoomSpeed=1,this.enableRotate=!0,this.rotateSpeed=1,this.keyRotateSpeed=1,this.enablePan=!0,this.panSpeed=1,this.screenSpacePanning=!0,this.keyPanSpeed=7,this.zoomToCursor=!1,this.autoRotate=!1,this.autoRotateSpeed=2,this.keys={LEFT:"ArrowLeft",UP:"ArrowUp",RIGHT:"ArrowRight",BOTTOM:"ArrowDown"},this.mouseButtons={LEFT:ws.ROTATE,MIDDLE:ws.DOLLY,RIGHT:ws.PAN},this.touches={ONE:Es.ROTATE,TWO:Es.DOLLY_PAN},this.target0=this.target.clone(),this.position0=this.object.position.clone(),this.zoom0=this.object.zoom,this._domElementKeyEvents=null,this._lastPosition=new H,this._lastQuaternion=new Un,this._lastTargetPosition=new H,this._quat=new Un().setFromUnitVectors(t.up,new H(0,1,0)),this._quatInverse=this._quat.clone().invert(),this._spherical=new Ss,this._sphericalDelta=new Ss,this._scale=1,this._panOffset=new H,this._rotateStart=new Jt,this._rotateEnd=new Jt,this._rotateDelta=new Jt,this._panStart=new Jt,this._panEnd=new Jt,this._panDelta=new Jt,this._dollyStart=new Jt,this._dollyEnd=new Jt,this._dollyDelta=new Jt,this._dollyDirection=new H,this._mouse=new Jt,this._performCursorZoom=!1,this._pointers=[],this._pointerPositions={},this._controlActive=!1,this._onPointerMove=MS.bind(this),this._onPointerDown=vS.bind(this),this._onPointerUp=bS.bind(this),this._onContextMenu=CS.bind(this),this._onMouseWheel=ES.bind(this),this._onKeyDown=TS.bind(this),this._onTouchStart=AS.bind(this),this._onTouchMove=RS.bind(this),this._onMouseDown=SS.bind(this),this._onMouseMove=wS.bind(this),this._interceptControlDown=PS.bind(this),this._interceptControlUp=IS.bind(this),this.domElement!==null&&this.connect(this.domElement),this.update()}connect(t){super.connect(t),this.domElement.addEventListener("pointerdown",this._onPointerDown),this.domElement.addEventListener("pointercancel",this._onPointerUp),this.domElement.addEventListener("contextmenu",this._onContextMenu),this.domElement.addEventListener("wheel",this._onMouseWheel,{passive:!1}),this.domElement.getRootNode().addEventListener("keydown",this._interceptControlDown,{passive:!0,capture:!0}),this.domElement.style.touchAction="none"}disconnect(){this.domElement.removeEventListener("pointerdown",this._onPointerDown),this.domElement.removeEventListener("pointermove",this._onPointerMove),this.domElement.removeEventListener("pointerup",this._onPointerUp),this.domElement.removeEventListener("pointercancel",this._onPointerUp),this.domElement.removeEventListener("wheel",this._onMouseWheel),this.domElement.removeEventListener("contextmenu",this._onContextMenu),this.stopListenToKeyEvents(),this.domElement.getRootNode().removeEventListener("keydown",this._interceptControlDown,{capture:!0}),this.domElement.style.touchAction="auto"}dispose(){this.disconnect()}getPolarAngle(){return this._spherical.phi}getAzimuthalAngle(){return this._spherical.theta}getDistance(){return this.object.position.distanceTo(this.target)}listenToKeyEvents(t){t.addEventListener("keydown",this._onKeyDown),this._domElementKeyEvents=t}stopListenToKeyEvents(){this._domElementKeyEvents!==null&&(this._domElementKeyEvents.removeEventListener("keydown",this._onKeyDown),this._domElementKeyEvents=null)}saveState(){this.target0.copy(this.target),this.position0.copy(this.object.position),this.zoom0=this.object.zoom}reset(){this.target.copy(this.target0),this.object.position.copy(this.position0),this.object.zoom=this.zoom0,this.object.updateProjectionMatrix(),this.dispatchEvent(km),this.update(),this.state=Ce.NONE}update(t=null){let e=this.object.position;cn.copy(e).sub(this.target),cn.applyQuaternion(this._quat),this._spherical.setFromVector3(cn),this.autoRotate&&this.state===Ce.NONE&&this._rotateLeft(this._getAutoRotationAngle(t)),this.enableDamping?(this._spherical.theta+=this._sphericalDelta.theta*this.dampingFactor,this._spherical.phi+=this._sphericalDelta.phi*this.dampingFactor):(this._spherical.theta+=this._sphericalDelta.theta,this._spherical.phi+=this._sphericalDelta.phi);let n=this.minAzimuthAngle,s=this.maxAzimuthAngle;isFinite(n)&&isFinite(s)&&(n<-Math.PI?n+=Hn:n>Math.PI&&(n-=Hn),s<-Math.PI?s+=Hn:s>Math.PI&&(s-=Hn),n<=s?this._spherical.theta=Math.max(n,Math.min(s,this._spherical.theta)):this._spherical.theta=this._spherical.theta>(n+s)/2?Math.max(n,this._spherical.theta):Math.min(s,this._spherical.theta)),this._spherical.phi=Math.max(this.minPolarAngle,Math.min(this.maxPolarAngle,this._spherical.phi)),this._spherical.makeSafe(),this.enableDamping===!0?this.target.addScaledVector(this._panOffset,this.dampingFactor):this.target.add(this._panOffset),this.target.sub(this.cursor),this.target.clampLength(this.minTargetRadius,this.maxTargetRadius),this.target.add(this.cursor);let r=!1;if(this.zoomToCursor&&this._performCursorZoom||this.object.isOrthographicCamera)this._spherical.radius=this._clampDistance(this._spherical.radius);else{let o=this._spherical.radius;this._spherical.radius=this._clampDistance(this._spherical.radius*this._scale),r=o!=this._spherical.radius}if(cn.setFromSpherical(this._spherical),cn.applyQuaternion(this._quatInverse),e.copy(this.target).add(cn),this.object.lookAt(this.target),this.enableDamping===!0?(this._sphericalDelta.theta*=1-this.dampingFactor,this._sphericalDelta.phi*=1-this.dampingFactor,this._panOffset.multiplyScalar(1-this.dampingFactor)):(this._sphericalDelta.set(0,0,0),this._panOffset.set(0,0,0)),this.zoomToCursor&&this._performCursorZoom){let o=null;if(this.object.isPerspectiveCamera){let a=cn.length();o=this._clampDistance(a*this._scale);let c=a-o;this.object.position.addScaledVector(this._dollyDirection,c),this.object.updateMatrixWorld(),r=!!c}else if(this.object.isOrthographicCamera){let a=new H(this._mouse.x,this._mouse.y,0);a.unproject(this.object);let c=this.object.zoom;this.object.zoom=Math.max(this.minZoom,Math.min(this.maxZoom,this.object.zoom/this._scale)),this.object.updateProjectionMatrix(),r=c!==this.object.zoom;let l=new H(this._mouse.x,this._mouse.y,0);l.unproject(this.object),this.object.position.sub(l).add(a),this.object.updateMatrixWorld(),o=cn.length()}else console.warn("WARNING: OrbitControls.js encountered an unknown camera type - zoom to cursor disabled."),this.zoomToCursor=!1;o!==null&&(this.screenSpacePanning?this.target.set(0,0,-1).transformDirection(this.object.matrix).multiplyScalar(o).add(this.object.position):(_c.origin.copy(this.object.position),_c.direction.set(0,0,-1).transformDirection(this.object.matrix),Math.abs(this.object.up.dot(_c.direction))<yS?this.object.lookAt(this.target):(zm.setFromNormalAndCoplanarPoint(this.object.up,this.target),_c.intersectPlane(zm,this.target))))}else if(this.object.isOrthographicCamera){let o=this.object.zoom;this.object.zoom=Math.max(this.minZoom,Math.min(this.maxZoom,this.object.zoom/this._scale)),o!==this.object.zoom&&(this.object.updateProjectionMatrix(),r=!0)}return this._scale=1,this._performCursorZoom=!1,r||this._lastPosition.distanceToSquared(this.object.position)>Pu||8*(1-this._lastQuaternion.dot(this.object.quaternion))>Pu||this._lastTargetPosition.distanceToSquared(this.target)>Pu?(this.dispatchEvent(km),this._lastPosition.copy(this.object.position),this._lastQuaternion.copy(this.object.quaternion),this._lastTargetPosition.copy(this.target),!0):!1}_getAutoRotationAngle(t){return t!==null?Hn/60*this.autoRotateSpeed*t:Hn/60/60*this.autoRotateSpeed}_getZoomScale(t){let e=Math.abs(t*.01);return Math.pow(.95,this.zoomSpeed*e)}_rotateLeft(t){this._sphericalDelta.theta-=t}_rotateUp(t){this._sphericalDelta.phi-=t}_panLeft(t,e){cn.setFromMatrixColumn(e,0),cn.multiplyScalar(-t),this._panOffset.add(cn)}_panUp(t,e){this.screenSpacePanning===!0?cn.setFromMatrixColumn(e,1):(cn.setFromMatrixColumn(e,0),cn.crossVectors(this.object.up,cn)),cn.multiplyScalar(t),this._panOffset.add(cn)}_pan(t,e){let n=this.domElement;if(this.object.isPerspectiveCamera){let s=this.object.position;cn.copy(s).sub(this.target);let r=cn.length();r*=Math.tan(this.object.fov/2*Math.PI/180),this._panLeft(2*t*r/n.clientHeight,this.object.matrix),this._panUp(2*e*r/n.clientHeight,this.object.matrix)}else this.object.isOrthographicCamera?(this._panLeft(t*(this.object.right-this.object.left)/this.object.zoom/n.clientWidth,this.object.matrix),this._panUp(e*(this.object.top-this.object.bottom)/this.object.zoom/n.clientHeight,this.object.matrix)):(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - pan disabled."),this.enablePan=!1)}_dollyOut(t){this.object.isPerspectiveCamera||this.object.isOrthographicCamera?this._scale/=t:(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - dolly/zoom disabled."),this.enableZoom=!1)}_dollyIn(t){this.object.isPerspectiveCamera||this.object.isOrthographicCamera?this._scale*=t:(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - dolly/zoom disabled."),this.enableZoom=!1)}_updateZoomParameters(t,e){if(!this.zoomToCursor)return;this._performCursorZoom=!0;let n=this.domElement.getBoundingClientRect(),s=t-n.left,r=e-n.top,o=n.width,a=n.height;this._mouse.x=s/o*2-1,this._mouse.y=-(r/a)*2+1,this._dollyDirection.set(this._mouse.x,this._mouse.y,1).unproject(this.object).sub(this.object.position).normalize()}_clampDistance(t){return Math.max(this.minDistance,Math.min(this.maxDistance,t))}_handleMouseDownRotate(t){this._rotateStart.set(t.clientX,t.clientY)}_handleMouseDownDolly(t){this._updateZoomParameters(t.clientX,t.clientX),this._dollyStart.set(t.clientX,t.clientY)}_handleMouseDownPan(t){this._panStart.set(t.clientX,t.clientY)}_handleMouseMoveRotate(t){this._rotateEnd.set(t.clientX,t.clientY),this._rotateDelta.subVectors(this._rotateEnd,this._rotateStart).multiplyScalar(this.rotateSpeed);let e=this.domElement;this._rotateLeft(Hn*this._rotateDelta.x/e.clientHeight),this._rotateUp(Hn*this._rotateDelta.y/e.clientHeight),this._rotateStart.copy(this._rotateEnd),this.update()}_handleMouseMoveDolly(t){this._dollyEnd.set(t.clientX,t.clientY),this._dollyDelta.subVectors(this._dollyEnd,this._dollyStart),this._dollyDelta.y>0?this._dollyOut(this._getZoomScale(this._dollyDelta.y)):this._dollyDelta.y<0&&this._dollyIn(this._getZoomScale(this._dollyDelta.y)),this._dollyStart.copy(this._dollyEnd),this.update()}_handleMouseMovePan(t){this._panEnd.set(t.clientX,t.clientY),this._panDelta.subVectors(this._panEnd,this._panStart).multiplyScalar(this.panSpeed),this._pan(this._panDelta.x,this._panDelta.y),this._panStart.copy(this._panEnd),this.update()}_handleMouseWheel(t){this._updateZoomParameters(t.clientX,t.clientY),t.deltaY<0?this._dollyIn(this._getZoomScale(t.deltaY)):t.deltaY>0&&this._dollyOut(this._getZoomScale(t.deltaY)),this.update()}_handleKeyDown(t){let e=!1;switch(t.code){case this.keys.UP:t.ctrlKey||t.metaKey||t.shiftKey?this.enableRotate&&this._rotateUp(Hn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(0,this.keyPanSpeed),e=!0;break;case this.keys.BOTTOM:t.ctrlKey||t.metaKey||t.shiftKey?this.enableRotate&&this._rotateUp(-Hn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(0,-this.keyPanSpeed),e=!0;break;case this.keys.LEFT:t.ctrlKey||t.metaKey||t.shiftKey?this.enableRotate&&this._rotateLeft(Hn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(this.keyPanSpeed,0),e=!0;break;case this.keys.RIGHT:t.ctrlKey||t.metaKey||t.shiftKey?this.enableRotate&&this._rotateLeft(-Hn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(-this.keyPanSpeed,0),e=!0;break}e&&(t.preventDefault(),this.update())}_handleTouchStartRotate(t){if(this._pointers.length===1)this._rotateStart.set(t.pageX,t.pageY);else{let e=this._getSecondPointerPosition(t),n=.5*(t.pageX+e.x),s=.5*(t.pageY+e.y);this._rotateStart.set(n,s)}}_handleTouchStartPan(t){if(this._pointers.length===1)this._panStart.set(t.pageX,t.pageY);else{let e=this._getSecondPointerPosition(t),n=.5*(t.pageX+e.x),s=.5*(t.pageY+e.y);this._panStart.set(n,s)}}_handleTouchStartDolly(t){let e=this._getSecondPointerPosition(t),n=t.pageX-e.x,s=t.pageY-e.y,r=Math.sqrt(n*n+s*s);this._dollyStart.set(0,r)}_handleTouchStartDollyPan(t){this.enableZoom&&this._handleTouchStartDolly(t),this.enablePan&&this._handleTouchStartPan(t)}_handleTouchStartDollyRotate(t){this.enableZoom&&this._handleTouchStartDolly(t),this.enableRotate&&this._handleTouchStartRotate(t)}_handleTouchMoveRotate(t){if(this._pointers.length==1)this._rotateEnd.set(t.pageX,t.pageY);else{let n=this._getSecondPointerPosition(t),s=.5*(t.pageX+n.x),r=.5*(t.pageY+n.y);this._rotateEnd.set(s,r)}this._rotateDelta.subVectors(this._rotateEnd,this._rotateStart).multiplyScalar(this.rotateSpeed);let e=this.domElement;this._rotateLeft(Hn*this._rotateDelta.x/e.clientHeight),this._rotateUp(Hn*this._rotateDelta.y/e.clientHeight),this._rotateStart.copy(this._rotateEnd)}_handleTouchMovePan(t){if(this._pointers.length===1)this._panEnd.set(t.pageX,t.pageY);else{let e=this._getSecondPointerPosition(t),n=.5*(t.pageX+e.x),s=.5*(t.pageY+e.y);this._panEnd.set(n,s)}this._panDelta.subVectors(this._panEnd,this._panStart).multiplyScalar(this.panSpeed),this._pan(this._panDelta.x,this._panDelta.y),this._panStart.copy(this._panEnd)}_handleTouchMoveDolly(t){let e=this._getSecondPointerPosition(t),n=t.pageX-e.x,s=t.pageY-e.y,r=Math.sqrt(n*n+s*s);this._dollyEnd.set(0,r),this._dollyDelta.set(0,Math.pow(this._dollyEnd.y/this._dollyStart.y,this.zoomSpeed)),this._dollyOut(this._dollyDelta.y),this._dollyStart.copy(this._dollyEnd);let o=(t.pageX+e.x)*.5,a=(t.pageY+e.y)*.5;this._updateZoomParameters(o,a)}_handleTouchMoveDollyPan(t){this.enableZoom&&this._handleTouchMoveDolly(t),this.enablePan&&this._handleTouchMovePan(t)}_handleTouchMoveDollyRotate(t){this.enableZoom&&this._handleTouchMoveDolly(t),this.enableRotate&&this._handleTouchMoveRotate(t)}_addPointer(t){this._pointers.push(t.pointerId)}_removePointer(t){delete this._pointerPositions[t.pointerId];for(let e=0;e<this._pointers.length;e++)if(this._pointers[e]==t.pointerId){this._pointers.splice(e,1);return}}_isTrackingPointer(t){for(let e=0;e<this._pointers.length;e++)if(this._pointers[e]==t.pointerId)return!0;return!1}_trackPointer(t){let e=this._pointerPositions[t.pointerId];e===void 0&&(e=new Jt,this._pointerPositions[t.pointerId]=e),e.set(t.pageX,t.pageY)}_getSecondPointerPosition(t){let e=t.pointerId===this._pointers[0]?this._pointers[1]:this._pointers[0];return this._pointerPositions[e]}_customWheelEvent(t){let e=t.deltaMode,n={clientX:t.clientX,clientY:t.clientY,deltaY:t.deltaY};switch(e){case 1:n.deltaY*=16;break;case 2:n.deltaY*=100;break}return t.ctrlKey&&!this._controlActive&&(n.deltaY*=10),n}};function vS(i){this.enabled!==!1&&(this._pointers.length===0&&(this.domElement.setPointerCapture(i.pointerId),this.domElement.addEventListener("pointermove",this._onPointerMove),this.domElement.addEventListener("pointerup",this._onPointerUp)),!this._isTrackingPointer(i)&&(this._addPointer(i),i.pointerType==="touch"?this._onTouchStart(i):this._onMouseDown(i)))}function MS(i){this.enabled!==!1&&(i.pointerType==="touch"?this._onTouchMove(i):this._onMouseMove(i))}function bS(i){switch(this._removePointer(i),this._pointers.length){case 0:this.domElement.releasePointerCapture(i.pointerId),this.domElement.removeEventListener("pointermove",this._onPointerMove),this.domElement.removeEventListener("pointerup",this._onPointerUp),this.dispatchEvent(Vm),this.state=Ce.NONE;break;case 1:let t=this._pointers[0],e=this._pointerPositions[t];this._onTouchStart({pointerId:t,pageX:e.x,pageY:e.y});break}}function SS(i){let t;switch(i.button){case 0:t=this.mouseButtons.LEFT;break;case 1:t=this.mouseButtons.MIDDLE;break;case 2:t=this.mouseButtons.RIGHT;break;default:t=-1}switch(t){case ws.DOLLY:if(this.enableZoom===!1)return;this._handleMouseDownDolly(i),this.state=Ce.DOLLY;break;case ws.ROTATE:if(i.ctrlKey||i.metaKey||i.shiftKey){if(this.enablePan===!1)return;this._handleMouseDownPan(i),this.state=Ce.PAN}else{if(this.enableRotate===!1)return;this._handleMouseDownRotate(i),this.state=Ce.ROTATE}break;case ws.PAN:if(i.ctrlKey||i.metaKey||i.shiftKey){if(this.enableRotate===!1)return;this._handleMouseDownRotate(i),this.state=Ce.ROTATE}else{if(this.enablePan===!1)return;this._handleMouseDownPan(i),this.state=Ce.PAN}break;default:this.state=Ce.NONE}this.state!==Ce.NONE&&this.dispatchEvent(Iu)}function wS(i){switch(this.state){case Ce.ROTATE:if(this.enableRotate===!1)return;this._handleMouseMoveRotate(i);break;case Ce.DOLLY:if(this.enableZoom===!1)return;this._handleMouseMoveDolly(i);break;case Ce.PAN:if(this.enablePan===!1)return;this._handleMouseMovePan(i);break}}function ES(i){this.enabled===!1||this.enableZoom===!1||this.state!==Ce.NONE||(i.preventDefault(),this.dispatchEvent(Iu),this._handleMouseWheel(this._customWheelEvent(i)),this.dispatchEvent(Vm))}function TS(i){this.enabled!==!1&&this._handleKeyDown(i)}function AS(i){switch(this._trackPointer(i),this._pointers.length){case 1:switch(this.touches.ONE){case Es.ROTATE:if(this.enableRotate===!1)return;this._handleTouchStartRotate(i),this.state=Ce.TOUCH_ROTATE;break;case Es.PAN:if(this.enablePan===!1)return;this._handleTouchStartPan(i),this.state=Ce.TOUCH_PAN;break;default:this.state=Ce.NONE}break;case 2:switch(this.touches.TWO){case Es.DOLLY_PAN:if(this.enableZoom===!1&&this.enablePan===!1)return;this._handleTouchStartDollyPan(i),this.state=Ce.TOUCH_DOLLY_PAN;break;case Es.DOLLY_ROTATE:if(this.enableZoom===!1&&this.enableRotate===!1)return;this._handleTouchStartDollyRotate(i),this.state=Ce.TOUCH_DOLLY_ROTATE;break;default:this.state=Ce.NONE}break;default:this.state=Ce.NONE}this.state!==Ce.NONE&&this.dispatchEvent(Iu)}function RS(i){switch(this._trackPointer(i),this.state){case Ce.TOUCH_ROTATE:if(this.enableRotate===!1)return;this._handleTouchMoveRotate(i),this.update();break;case Ce.TOUCH_PAN:if(this.enablePan===!1)return;this._handleTouchMovePan(i),this.update();break;case Ce.TOUCH_DOLLY_PAN:if(this.enableZoom===!1&&this.enablePan===!1)return;this._handleTouchMoveDollyPan(i),this.update();break;case Ce.TOUCH_DOLLY_ROTATE:if(this.enableZoom===!1&&this.enableRotate===!1)return;this._handleTouchMoveDollyRotate(i),this.update();break;default:this.state=Ce.NONE}}function CS(i){this.enabled!==!1&&i.preventDefault()}function PS(i){i.key==="Control"&&(this._controlActive=!0,this.domElement.getRootNode().addEventListener("keyup",this._interceptControlUp,{passive:!0,capture:!0}))}function IS(i){i.key==="Control"&&(this._controlActive=!1,this.domElement.getRootNode().removeEventListener("keyup",this._interceptControlUp,{passive:!0,capture:!0}))}function Gm(i,t=!1){let e=i[0].index!==null,n=new Set(Object.keys(i[0].attributes)),s=new Set(Object.keys(i[0].morphAttributes)),r={},o={},a=i[0].morphTargetsRelative,c=new Qe,l=0;for(let h=0;h<i.length;++h){let u=i[h],d=0;if(e!==(u.index!==null))return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+". All geometries must have compatible attributes; make sure index attribute exists among all geometries, or in none of them."),null;for(let f in u.attributes){if(!n.has(f))return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+'. All geometries must have compatible attributes; make sure "'+f+'" attribute exists among all geometries, or in none of them.'),null;r[f]===void 0&&(r[f]=[]),r[f].push(u.attributes[f]),d++}if(d!==n.size)return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+". Make sure all geometries have the same number of attributes."),null;if(a!==u.morphTargetsRelative)return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+". .morphTargetsRelative must be consistent throughout all geometries."),null;for(let f in u.morphAttributes){if(!s.has(f))return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+".  .morphAttributes must be consistent throughout all geometries."),null;o[f]===void 0&&(o[f]=[]),o[f].push(u.morphAttributes[f])}if(t){let f;if(e)f=u.index.count;else if(u.attributes.position!==void 0)f=u.attributes.position.count;else return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed with geometry at index "+h+". The geometry must have either an index or a position attribute"),null;c.addGroup(l,f,h),l+=f}}if(e){let h=0,u=[];for(let d=0;d<i.length;++d){let f=i[d].index;for(let g=0;g<f.count;++g)u.push(f.getX(g)+h);h+=i[d].attributes.position.count}c.setIndex(u)}for(let h in r){let u=Hm(r[h]);if(!u)return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed while trying to merge the "+h+" attribute."),null;c.setAttribute(h,u)}for(let h in o){let u=o[h][0].length;if(u===0)break;c.morphAttributes=c.morphAttributes||{},c.morphAttributes[h]=[];for(let d=0;d<u;++d){let f=[];for(let x=0;x<o[h].length;++x)f.push(o[h][x][d]);let g=Hm(f);if(!g)return console.error("THREE.BufferGeometryUtils: .mergeGeometries() failed while trying to merge the "+h+" morphAttribute."),null;c.morphAttributes[h].push(g)}}return c}function Hm(i){let t,e,n,s=-1,r=0;for(let l=0;l<i.length;++l){let h=i[l];if(t===void 0&&(t=h.array.constructor),t!==h.array.constructor)return console.error("THREE.BufferGeometryUtils: .mergeAttributes() failed. BufferAttribute.array must be of consistent array types across matching attributes."),null;if(e===void 0&&(e=h.itemSize),e!==h.itemSize)return console.error("THREE.BufferGeometryUtils: .mergeAttributes() failed. BufferAttribute.itemSize must be consistent across matching attributes."),null;if(n===void 0&&(n=h.normalized),n!==h.normalized)return console.error("THREE.BufferGeometryUtils: .mergeAttributes() failed. BufferAttribute.normalized must be consistent across matching attributes."),null;if(s===-1&&(s=h.gpuType),s!==h.gpuType)return console.error("THREE.BufferGeometryUtils: .mergeAttributes() failed. BufferAttribute.gpuType must be consistent across matching attributes."),null;r+=h.count*e}let o=new t(r),a=new Oe(o,e,n),c=0;for(let l=0;l<i.length;++l){let h=i[l];if(h.isInterleavedBufferAttribute){let u=c/e;for(let d=0,f=h.count;d<f;d++)for(let g=0;g<e;g++){let x=h.getComponent(d,g);a.setComponent(d+u,g,x)}}else o.set(h.array,c);c+=h.count*e}return s!==void 0&&(a.gpuType=s),a}var LS={hardware:3e5,software:26e3},Wm=[[20,0],[12,.03],[8,.08],[6,.15],[5,.25],[4,.35],[3,.5]],DS=90,NS=12,Xm=new jt(-1,-1,-1),US=`
attribute vec4 base; varying vec3 tint;
void main() {
  vec3 n = normalize(mat3(instanceMatrix) * normal);
  vec3 paint = instanceColor.r < 0.0 ? vec3(0.26, 0.28, 0.3) : mix(base.rgb, instanceColor, base.a);
  tint = paint * (0.66 + 0.3 * dot(n, vec3(-0.32, -0.48, 0.82)) + 0.18 * n.z);
  gl_Position = projectionMatrix * viewMatrix * instanceMatrix * vec4(position, 1.0);
}`,FS=`
uniform float opacity; varying vec3 tint;
void main() {
  gl_FragColor = vec4(tint, opacity);
  #include <colorspace_fragment>
}`,so=class{constructor(t,e,n){this.room=e,this.vehicles=new Array(e).fill(-1),this.painted=new Array(e).fill(null),this.count=0,this.mesh=new js(t,n,e),this.mesh.frustumCulled=!1,this.mesh.instanceMatrix.setUsage(ts);for(let s=0;s<e;s++)this.mesh.setColorAt(s,Xm)}add(t,e,n,s){let r=this.count++;this.mesh.setMatrixAt(r,e),!(this.vehicles[r]===t&&this.painted[r]===s)&&(this.mesh.setColorAt(r,s?n:Xm),this.mesh.instanceColor.needsUpdate=!0,[this.vehicles[r],this.painted[r]]=[t,s])}finish(){this.mesh.count=this.count,this.mesh.visible=this.count>0,this.mesh.instanceMatrix.needsUpdate=!0,this.count=0}},ro=class{constructor(t,e,n=1){let{kinds:s,kind:r}=t.said;this.run=t;let o=s.map((h,u)=>r.filter(d=>d===u).length),a=LS[e?"software":"hardware"],c=Du(n),l;for(let[h,u]of Wm)if(l=s.map(d=>na(d,h,u)),l.reduce((d,f,g)=>d+o[g]*f.index.count/3,0)<=a)break;this.usual=l.map((h,u)=>new so(h,o[u],c)),this.near=s.map((h,u)=>new so(na(h,...Wm[0]),Math.min(o[u],NS),c)),this.group=new qi,this.group.add(...[...this.usual,...this.near].map(({mesh:h})=>h)),this.groupColours=t.said.groups.map(h=>new jt(h.colour)),this.colours=t.groupOf.map(h=>this.groupColours[h]),this.matrix=new Re,this.turn=new Un,this.at=new H,this.size=new H,this.ahead=new H}update(t,e,n,s,r,o){let{kind:a,kinds:c}=this.run.said;for(let l=0;l<this.run.vehicles;l++){let h=a[l],u=Number.isNaN(t[3*l])?0:n[l];this.turn.set(e[4*l+1],e[4*l+2],e[4*l+3],e[4*l]).normalize(),this.size.setScalar(u),this.at.set(t[3*l]||0,t[3*l+1]||0,t[3*l+2]||0);let d=2*c[h].radius*u/(o*this.at.distanceTo(r.position));this.at.add(this.ahead.set(-c[h].ahead*u,0,0).applyQuaternion(this.turn)),this.matrix.compose(this.at,this.turn,this.size);let f=!s||l>=this.run.agents||s[l];(d>DS&&this.near[h].count<this.near[h].room?this.near[h]:this.usual[h]).add(l,this.matrix,this.colours[l],f)}for(let l of[...this.usual,...this.near])l.finish()}};function Du(i){let t=new on({vertexShader:US,fragmentShader:FS,uniforms:{opacity:{value:i}}});return Object.assign(t,{transparent:i<1,depthWrite:i===1})}function na(i,t,e){let n=i.solids.filter(o=>Lu(o)>=e*i.radius),r=(n.length||!i.solids.length?n:[i.solids.reduce((o,a)=>Lu(a)>Lu(o)?a:o)]).map(o=>{let a=BS(o,t);a.applyQuaternion(new Un(...o.quaternion.slice(1),o.quaternion[0])),a.translate(...o.position);for(let h of Object.keys(a.attributes))h!=="position"&&h!=="normal"&&a.deleteAttribute(h);let c=new jt().setRGB(...o.colour,Nn),l=new Float32Array(a.attributes.position.count*4);for(let h=0;h<l.length;h+=4)l.set([c.r,c.g,c.b,o.livery?1:0],h);return a.setAttribute("base",new Oe(l,4)),a});return r.length?Gm(r):na({radius:i.radius,solids:[{...OS,size:[i.radius]}]},t,0)}var OS={shape:"sphere",position:[0,0,0],quaternion:[1,0,0,0],colour:[.6,.6,.6],livery:!0};function Lu({shape:i,size:t}){return i==="mesh"?1/0:i==="capsule"||i==="cylinder"?t[0]+t[1]:Math.max(...t)}function BS({shape:i,size:t,vertices:e,faces:n},s){let r=Math.max(3,s>>1);if(i==="box")return new ys(2*t[0],2*t[1],2*t[2]);if(i==="sphere")return new vs(t[0],s,r);if(i==="ellipsoid")return new vs(1,s,r).scale(...t);if(i==="cylinder")return new $r(t[0],t[0],2*t[1],s).rotateX(Math.PI/2);if(i==="capsule")return(s<=6?new $r(t[0],t[0],2*t[1],s,1):new Wo(t[0],2*t[1],Math.max(2,s>>2),s,1)).rotateX(Math.PI/2);let o=c=>Uint8Array.from(atob(c),l=>l.charCodeAt(0)).buffer,a=new Qe;return a.setAttribute("position",new Oe(new Float32Array(o(e)),3)),a.setIndex(new Oe(new Uint32Array(o(n)),1)),a.computeVertexNormals(),a}var kS=.38,yc=class{constructor(t,e,n){this.run=t,this.runs=t.said.ghosts.map(({colour:s},r)=>{let o=new ro(t,e,kS),a=s&&new jt(s);return a&&(o.colours=o.colours.map(()=>a)),n.add(o.group),{k:r,bodies:o,tint:a,positions:new Float32Array(t.vehicles*3),quaternions:new Float32Array(t.vehicles*4)}})}draw(t,e,n,s,r,o,a,c){for(let{k:l,bodies:h,tint:u,positions:d,quaternions:f}of this.runs)if(h.group.visible=a,!!a){this.run.at(`ghost${l}`,t,d),this.run.at(`ghost_quaternion${l}`,t,f),h.update(d,f,e,null,n,s);for(let g=0;g<3*this.run.agents;g+=3)Number.isNaN(d[g])||r.add(o[g],o[g+1],o[g+2],d[g],d[g+1],d[g+2],u??c,.7,1.2)}}};var Nu=6,Uu=16,Ym=8,zS=`
attribute vec3 start; attribute vec3 end; attribute vec4 colour; attribute vec4 style;
uniform vec2 size; varying vec4 shade; varying float along; varying float dash;
void main() {
  vec4 p = projectionMatrix * viewMatrix * vec4(start, 1.0);
  vec4 q = projectionMatrix * viewMatrix * vec4(end, 1.0);
  float near = 0.01;
  bool behind = p.w < near && q.w < near;
  if (p.w < near && q.w > near) p = mix(q, p, (q.w - near) / (q.w - p.w));
  else if (q.w < near && p.w > near) q = mix(p, q, (p.w - near) / (p.w - q.w));
  vec2 way = (q.xy / q.w - p.xy / p.w) * size * 0.5;
  float far = length(way);
  vec2 unit = far > 0.0 ? way / far : vec2(1.0, 0.0);
  float last = mod(style.x, 2.0);  // which end this corner is at, and on which side
  float side = style.x < 2.0 ? -1.0 : 1.0;
  vec4 c = last > 0.5 ? q : p;
  c.xy += vec2(-unit.y, unit.x) * side * (mix(style.y, style.w, last) / ${Uu}.0) / size * c.w;
  shade = colour;
  along = last * far;
  dash = style.z / ${Ym}.0;
  gl_Position = behind ? vec4(2.0, 2.0, 2.0, 1.0) : c;
}`,VS=`
varying vec4 shade; varying float along; varying float dash;
void main() {
  if (dash > 0.0 && mod(along, 2.0 * dash) > dash) discard;
  gl_FragColor = shade;
}`,ia=class{constructor(t){this.room=Math.max(t,1),this.count=0,this.floats=new Float32Array(this.room*4*Nu);let e=new Qe;this.ends=new Ks(this.floats,Nu).setUsage(ts),this.looks=new Ks(new Uint8Array(this.room*4*8),8).setUsage(ts),this.look=this.looks.array,e.setAttribute("start",new Ji(this.ends,3,0)),e.setAttribute("end",new Ji(this.ends,3,3)),e.setAttribute("colour",new Ji(this.looks,4,0,!0)),e.setAttribute("style",new Ji(this.looks,4,4,!1));let n=new Uint32Array(this.room*6);for(let s=0;s<this.room;s++)n.set([4*s,4*s+1,4*s+3,4*s,4*s+3,4*s+2],6*s);e.setIndex(new Oe(n,1)),this.material=new on({vertexShader:zS,fragmentShader:VS,uniforms:{size:{value:new Jt(1,1)}},transparent:!0,depthWrite:!1}),this.mesh=new tn(e,this.material),this.mesh.frustumCulled=!1,this.geometry=e}clear(){this.count=0}add(t,e,n,s,r,o,a,c,l,h=0,u=c,d=l){if(this.count>=this.room||Number.isNaN(t+e+n+s+r+o))return;let{floats:f,look:g}=this,[x,m,p]=HS(a),w=4*this.count++;for(let E=0;E<4;E++){let v=(w+E)*Nu;f[v]=t,f[v+1]=e,f[v+2]=n,f[v+3]=s,f[v+4]=r,f[v+5]=o;let C=(w+E)*8;g[C]=x,g[C+1]=m,g[C+2]=p,g[C+3]=255*(E&1?u:c),g[C+4]=E,g[C+5]=Math.min(l*Uu,255),g[C+6]=Math.min(h*Ym,255),g[C+7]=Math.min(d*Uu,255)}}finish(t,e){this.material.uniforms.size.value.set(t,e),this.geometry.setDrawRange(0,6*this.count),this.mesh.visible=this.count>0;for(let n of[this.ends,this.looks])n.clearUpdateRanges(),n.addUpdateRange(0,4*this.count*n.stride),n.needsUpdate=!0}},qm=new WeakMap;function HS(i){let t=qm.get(i);if(!t||t.r!==i.r||t.g!==i.g||t.b!==i.b){let e=i.getHex();t=Object.assign([e>>16,e>>8&255,e&255],{r:i.r,g:i.g,b:i.b}),qm.set(i,t)}return t}var GS=24,$m=[18,15],Zm=.35,WS=new jt(1,1,1),vc=class{constructor(t,e){this.run=t,this.places=new Float32Array(3*t.said.obstacles.length),this.matrix=new Re,this.shapes=t.said.obstacles.map(n=>new so(na({radius:1,solids:[n]},GS,0),1,Du(n.opacity))),this.shapes.length&&e.add(...this.shapes.map(({mesh:n})=>n)),this.ends=new Float32Array(3*t.agents)}draw(t,e,n,s,r,o,a){let{run:c,places:l,ends:h}=this;if(!c.series.cause||(c.at("obstacle",t,l),this.shapes.forEach((d,f)=>{d.add(f,this.matrix.makeTranslation(l[3*f],l[3*f+1],l[3*f+2]),WS,!0),d.finish()}),!o))return;let[u]=c.locate(t);c.at("kept_from",t,h);for(let d=0;d<c.agents;d++){if(!c.keptFrom(u,d)||Number.isNaN(h[3*d]))continue;let f=n.subarray(3*d,3*d+3),g=h.subarray(3*d,3*d+3),x=Math.hypot(...g.map((p,w)=>p-f[w])),m=p=>f.map((w,E)=>w+p*(g[E]-w));e.add(...f,...g,s,.95,d===r?4:2.5),e.add(...m(Math.min(Zm+$m[0]*a/Math.max(x,1e-9),.8)),...m(Zm),s,.95,$m[1],0,.95,0)}}};var _n=141,XS=30,Jm=6.5,qS=1.5,YS=12,Km={light:{deep:"#0f4a6e",crest:"#5f9fb2",zenith:"#5585c2",sun:.5},dark:{deep:"#06202f",crest:"#24586b",zenith:"#22405e",sun:.25}},$S=`
attribute vec3 slope; varying vec3 place; varying vec3 up; varying float high;
void main() {
  vec4 p = modelMatrix * vec4(position, 1.0);
  place = p.xyz;
  up = vec3(-slope.x, -slope.y, 1.0);
  high = slope.z;
  gl_Position = projectionMatrix * viewMatrix * p;
}`,ZS=`
uniform vec3 deep, crest, zenith, sky; uniform float sun, distance; varying vec3 place; varying vec3 up; varying float high;
void main() {
  vec3 n = normalize(up);
  vec3 toEye = cameraPosition - place;
  float away = length(toEye);
  toEye /= away;
  float facing = clamp(dot(n, toEye), 0.0, 1.0);
  vec3 mirrored = 2.0 * facing * n - toEye;
  vec3 light = vec3(0.48, 0.36, 0.80);
  vec3 above = mix(sky, zenith, clamp(mirrored.z, 0.0, 1.0));
  vec3 water = mix(deep, crest, clamp(0.5 + high, 0.0, 1.0)) * (0.25 + 0.9 * clamp(dot(n, light), 0.0, 1.0));
  vec3 c = mix(water, above, 0.02 + 0.98 * pow(1.0 - facing, 5.0)) + sun * pow(clamp(dot(mirrored, light), 0.0, 1.0), 60.0);
  float haze = 1.0 - exp(-3.0 * pow(away / (${YS}.0 * distance), 2.0));
  gl_FragColor = vec4(mix(c, sky, haze), mix(0.88, 1.0, haze));
  #include <colorspace_fragment>
}`,Mc=class{constructor(t,e){this.seas=t.said.seas.map(r=>({...r,size:Math.max(2.83*Math.hypot(...r.waves.map(([o])=>o)),1e-9)}));let n=new Qe;this.places=new Float32Array(3*_n*_n),this.slopes=new Float32Array(3*_n*_n),n.setAttribute("position",new Oe(this.places,3).setUsage(ts)),n.setAttribute("slope",new Oe(this.slopes,3).setUsage(ts));let s=[];for(let r=0;r<_n-1;r++)for(let o=0;o<_n-1;o++){let a=r*_n+o;s.push(a,a+_n,a+1,a+1,a+_n,a+_n+1)}n.setIndex(s),this.material=new on({vertexShader:$S,fragmentShader:ZS,uniforms:Object.fromEntries(["deep","crest","zenith","sky"].map(r=>[r,{value:new jt}]).concat([["sun",{value:.5}],["distance",{value:1}]])),transparent:!0,depthWrite:!1,side:Vn}),this.mesh=new tn(n,this.material),this.mesh.frustumCulled=!1,this.mesh.renderOrder=-1,this.graded=Float64Array.from({length:_n},(r,o)=>Math.sinh(Jm*(2*o/(_n-1)-1))/Math.sinh(Jm)),e.add(this.mesh)}setTheme(t,e){let{uniforms:n}=this.material;for(let s of["deep","crest","zenith"])n[s].value.set(Km[t][s]);n.sun.value=Km[t].sun,n.sky.value.copy(e)}at(t){return this.seas.findLast(({time:e})=>e<=t+1e-9)??this.seas[0]}elevation(t,e,n){let s=[0,0,0];for(let[r,o,a,c,l]of this.at(n).waves){let h=o*t+a*e-c*n+l;s[0]+=r*Math.cos(h),s[1]-=r*o*Math.sin(h),s[2]-=r*a*Math.sin(h)}return s}update(t,e,n){let s=this.at(t),{places:r,slopes:o,graded:a}=this,c=XS*n,l=s.waves.map(([h,u,d,f,g])=>{let x=(v,C)=>JS(a,v,C,c),[m,p]=[x(u,e.x),x(d,e.y)],[w,E]=[h*Math.cos(g-f*t),h*Math.sin(g-f*t)];return{kx:u,ky:d,x:m,y:p,re:w,im:E}});for(let h=0,u=0;h<_n;h++){let d=l.map(({x:f,re:g,im:x})=>[f.re[h]*g-f.im[h]*x,f.re[h]*x+f.im[h]*g]);for(let f=0;f<_n;f++,u+=3){let[g,x,m]=[0,0,0];for(let p=0;p<l.length;p++){let{kx:w,ky:E,y:v}=l[p],[C,A]=d[p];g+=C*v.re[f]-A*v.im[f];let D=C*v.im[f]+A*v.re[f];x-=w*D,m-=E*D}r[u]=e.x+c*a[h],r[u+1]=e.y+c*a[f],r[u+2]=s.level+g,o[u]=x,o[u+1]=m,o[u+2]=g/s.size}}this.material.uniforms.distance.value=n,this.mesh.geometry.attributes.position.needsUpdate=!0,this.mesh.geometry.attributes.slope.needsUpdate=!0}};function JS(i,t,e,n){let[s,r]=[new Float64Array(_n),new Float64Array(_n)];for(let o=0;o<_n;o++){let a=n*(i[Math.min(o+1,_n-1)]-i[Math.max(o-1,0)])/2,c=Math.exp(-((t*a/qS)**4)),l=t*(e+n*i[o]);s[o]=c*Math.cos(l),r[o]=c*Math.sin(l)}return{re:s,im:r}}var KS={light:{sky:"#f4f7f9",water:"#cfe2ec",ground:"#e9e5d9",none:"#e6ebf0",grid:"#7d97a6",ink:"#17222b",low:"#3f6fb5",high:"#c2410c",kept:"#d6006e",quiet:"#9aa3ab",flow:[["#cdbb86","#e0a020","#c23a00"],["#8fa6c9","#6a35a5","#c0109a"]]},dark:{sky:"#10161c",water:"#15303f",ground:"#262720",none:"#1a222a",grid:"#5f7b8b",ink:"#e6edf3",low:"#6ea3f0",high:"#ff8a3d",kept:"#ff4fa3",quiet:"#6d7780",flow:[["#6b6750","#d9a73a","#ff7a2e"],["#3f5c8f","#8a5ad6","#ff5ad2"]]}},jS={above:[-90,89.9],side:[-90,4]},bc=60,QS=.03,tw=9e3,ew=200,nw=6,iw=.95,Fu=[14,11],jm=.65,sw=30,Sc=class extends EventTarget{constructor(t,e,n,s){super(),Object.assign(this,{run:t,clock:e,canvas:n,labels:s}),this.layers={links:!0,goals:!0,trails:!0,names:!0,stems:t.agents<=100,larger:!0,ghosts:!0,safety:!0},t.said.flow.forEach((r,o)=>this.layers[`flow${o}`]=!0),this.lit=-1,this.followed="",this.dirty=!0,this.positions=new Float32Array(t.vehicles*3),this.quaternions=new Float32Array(t.vehicles*4),this.goals=new Float32Array(t.agents*3),this.residuals=new Float32Array(t.said.edges.length),this.present=new Array(t.agents).fill(!0),this.screen=new Float32Array(t.vehicles*2).fill(NaN),this.measure(),this.software=rw(),this.renderer=new mc({canvas:n,antialias:!this.software,powerPreference:"high-performance"}),this.scene=new zo,this.camera=new wn(42,1,.1,1e5),this.camera.up.set(0,0,1),this.controls=new xc(this.camera,n),this.controls.screenSpacePanning=!0,this.controls.zoomToCursor=!0,this.controls.addEventListener("change",()=>this.changed()),this.controls.addEventListener("start",()=>this.touched=!0),this.build(),this.setTheme("light"),this.pointing(),new ResizeObserver(()=>this.resize()).observe(n.parentElement),this.resize()}changed(){this.dirty=!0,this.dispatchEvent(new Event("view"))}measure(){let{run:t}=this,{centre:e,size:n}=t.said,s=new oi,r=[];this.seen=[];let o=Math.max(1,Math.floor(t.vehicles*Math.min(t.time.length,200)/4e3)),a=new H,c=Math.max(1,Math.floor(t.time.length/200));for(let d=0;d<t.time.length;d+=c)for(let f=0;f<t.vehicles;f++)f<t.agents&&!t.present(d,f)||(a.fromArray(t.series.position,(d*t.vehicles+f)*3),Math.max(Math.abs(a.x-e[0]),Math.abs(a.y-e[1]),Math.abs(a.z-e[2]))<3*n&&(s.expandByPoint(a),(d/c+f)%o<1&&this.seen.push(a.x,a.y,a.z)));for(let d of t.said.live?.ahead??[])s.expandByPoint(a.fromArray(d)),this.seen.push(...d);s.isEmpty()&&s.expandByPoint(a.fromArray(e)),this.seen.length||this.seen.push(...e);let l=t.time.length-1,h=Math.max(1,Math.floor(t.vehicles/40));for(let d=0;d<t.vehicles;d+=h){let f=1/0;for(let g=0;g<t.vehicles;g++){let[x,m]=[(l*t.vehicles+d)*3,(l*t.vehicles+g)*3],p=t.series.position;d!==g&&(f=Math.min(f,Math.hypot(p[x]-p[m],p[x+1]-p[m+1],p[x+2]-p[m+2])))}Number.isFinite(f)&&r.push(f)}r.sort((d,f)=>d-f),this.gap=r.length?r[r.length>>1]:1/0;let u=Math.max(...t.said.kind.map((d,f)=>t.said.kinds[d].radius*t.said.scales[f]));this.largest=u,s.expandByScalar(u),this.box=s,this.extent=s.getSize(new H).length(),this.floor=t.said.surface==="none"?s.min.z:t.said.height}extend(){let{box:t,run:e}=this,n=new H,s=(e.time.length-1)*e.vehicles,r=o=>(o>=e.agents||e.present(e.time.length-1,o))&&!t.containsPoint(n.fromArray(e.series.position,3*(s+o)));if(e.names.some((o,a)=>r(a))){let o=1.1*this.extent;this.measure(),this.extent>o&&this.fit()}this.changed()}rescale(){this.residualRange=tg(this.run)}fit(){this.scene.remove(this.surface),this.surface.geometry.dispose(),this.surface.material.dispose(),this.surface=eg(this),this.scene.add(this.surface),this.surface.visible=!this.sea,this.setTheme(document.documentElement.dataset.theme??"light"),this.labelGrid(),!this.touched&&this.followed===""&&this.view("angle")}flowChanged(){this.flowsNow=null,this.changed()}build(){let{run:t,scene:e}=this;this.surface=eg(this),e.add(this.surface),this.sea=t.said.seas.length?new Mc(t,e):null,this.surface.visible=!this.sea,this.bodies=new ro(t,this.software),e.add(this.bodies.group),this.ghosts=new yc(t,this.software,e),this.obstacles=new vc(t,e);let n=new vs(1,t.agents>100?6:14,t.agents>100?4:8);this.balls=new js(n,new Js({transparent:!0,opacity:.5,depthWrite:!1}),t.agents),this.balls.frustumCulled=!1;for(let r=0;r<t.agents;r++)this.balls.setColorAt(r,this.bodies.colours[r]);e.add(this.balls),this.trailPieces=Math.max(4,Math.min(60,Math.floor(tw/t.vehicles))),this.joints=[];let s=t.said.edges.length;this.lines=new ia(2*s+t.vehicles*(2+this.trailPieces+2)+(4+t.said.ghosts.length)*t.agents+64),this.arrows=t.said.flow.map(r=>new ia(3*r.places.length)),e.add(this.lines.mesh,...this.arrows.map(({mesh:r})=>r)),this.residualRange=tg(t),this.makeLabels()}uncovered(){let{left:t,top:e}=this.canvas.getBoundingClientRect(),n=([r,o,a,c])=>Math.max(a-r,0)*Math.max(c-o,0),s=[0,0,this.width,this.height];for(let r of document.querySelectorAll("#views, #card, #live")){let o=r.getBoundingClientRect(),a=[[0,o.right-t],[1,o.bottom-e],[2,o.left-t],[3,o.top-e]].map(([l,h])=>s.with(l,h));o.right-t>s[0]&&o.bottom-e>s[1]&&o.left-t<s[2]&&o.top-e<s[3]&&o.width&&(s=a.reduce((l,h)=>n(h)>n(l)?h:l))}return s}view(t){let[e,n]=(jS[t]??this.run.said.view).map(x=>x*Math.PI/180),s=new H(Math.cos(n)*Math.cos(e),Math.cos(n)*Math.sin(e),Math.sin(n)),{camera:r}=this,o=this.box.getCenter(new H),a=Math.tan(r.fov*Math.PI/360),c=2*this.extent,[l,h,u,d]=this.uncovered(),f=new Jt((l+u)/this.width-1,1-(h+d)/this.height);r.setViewOffset(this.width,this.height,-f.x*this.width/2,f.y*this.height/2,this.width,this.height);let g=new H;for(let x=0;x<12;x++){r.position.copy(o).addScaledVector(s,c),r.lookAt(o),[r.near,r.far]=[c/1e3,c*10],r.updateProjectionMatrix(),r.updateMatrixWorld();let[m,p]=[new Jt(1/0,1/0),new Jt(-1/0,-1/0)];for(let D=0;D<this.seen.length;D+=3)g.fromArray(this.seen,D).project(r),m.min(g),p.max(g);let{elements:w}=r.matrixWorld,[E,v]=[0,4].map(D=>new H(w[D],w[D+1],w[D+2]));o.addScaledVector(E,((m.x+p.x)/2-f.x)*c*a*r.aspect),o.addScaledVector(v,((m.y+p.y)/2-f.y)*c*a);let C=2*this.largest/(c*a),A=Math.max((p.x-m.x+C/r.aspect)*this.width/(u-l),(p.y-m.y+C)*this.height/(d-h));c*=Math.min(Math.max(A,.001)/2/iw,3),c=Math.max(c,4*this.largest)}this.controls.target.copy(o),r.position.copy(o).addScaledVector(s,c),this.controls.update(),this.anchor=null,this.touched=t!=="angle",this.changed()}get place(){return[...this.camera.position.toArray(),...this.controls.target.toArray()].map(t=>+t.toFixed(2)).join(",")}set place(t){let e=String(t).split(",").map(Number);e.length!==6||!e.every(Number.isFinite)||(this.touched=!0,this.camera.position.fromArray(e),this.controls.target.fromArray(e,3),this.controls.update(),this.changed())}follow(t,e=!0){if(this.followed=t,this.anchor=null,t!==""&&e){this.read();let n=this.middle(),s=this.camera.position.clone().sub(this.controls.target).normalize(),r=t==="team"?0:t,o=this.run.said.kinds[this.run.said.kind[r]].radius*(this.scales?.[r]??1),a=t==="team"?this.camera.position.distanceTo(this.controls.target):Math.max(o*10,Math.min(this.gap,this.extent)*1.1);this.controls.target.copy(n),this.camera.position.copy(n).addScaledVector(s,a),this.controls.update()}this.changed()}middle(){let t=new H;if(this.followed!=="team")return t.fromArray(this.positions,3*this.followed);let e=0;for(let n=0;n<this.run.agents;n++)!this.present[n]||Number.isNaN(this.positions[3*n])||(t.x+=this.positions[3*n],t.y+=this.positions[3*n+1],t.z+=this.positions[3*n+2],e++);return t.divideScalar(Math.max(e,1))}turn(t,e){this.touched=!0;let n=this.camera.position.clone().sub(this.controls.target),s=new Ss().setFromVector3(new H(n.x,n.z,-n.y));s.theta+=t*Math.PI/180,s.phi=Math.min(Math.max(s.phi-e*Math.PI/180,.002),Math.PI-.002);let r=new H().setFromSpherical(s);this.camera.position.copy(this.controls.target).add(new H(r.x,-r.z,r.y)),this.controls.update(),this.changed()}zoom(t){this.touched=!0,this.camera.position.sub(this.controls.target).multiplyScalar(t).add(this.controls.target),this.controls.update(),this.changed()}pan(t,e){this.touched=!0;let n=this.camera.position.distanceTo(this.controls.target),{elements:s}=this.camera.matrix,r=new H(s[0],s[1],s[2]).multiplyScalar(t*n);r.add(new H(s[4],s[5],s[6]).multiplyScalar(e*n)),this.camera.position.add(r),this.controls.target.add(r),this.controls.update(),this.changed()}resize(){let{clientWidth:t,clientHeight:e}=this.canvas.parentElement;!t||!e||(this.renderer.setPixelRatio(Math.min(window.devicePixelRatio,2)),this.renderer.setSize(t,e,!1),this.camera.aspect=t/e,this.camera.updateProjectionMatrix(),[this.width,this.height]=[t,e],!this.touched&&this.followed===""&&this.view("angle"),this.changed())}setTheme(t){let e=KS[t];this.theme=Object.fromEntries(Object.entries(e).map(([s,r])=>[s,s==="flow"?r.map(aw):new jt(r)])),this.scene.background=this.theme.sky;let{uniforms:n}=this.surface.material;n.colour.value=this.theme[this.run.said.surface],n.grid.value=this.theme.grid,n.sky.value=this.theme.sky,this.sea?.setTheme(t,this.theme.sky),this.flowsNow=null,this.changed()}share(t){let[e,n]=this.residualRange;return Math.min(Math.max(Math.log(Math.max(t,1e-12)/e)/Math.log(n/e),0),1)}read(){let{run:t,clock:e}=this;t.at("position",e.t,this.positions),t.at("quaternion",e.t,this.quaternions),t.at("q_star",e.t,this.goals);let[n,s]=t.locate(e.t);for(let r=0;r<t.agents;r++)this.present[r]=t.present(n,r);this.residuals.length&&this.residuals.set(t.series.residual.subarray(n*this.residuals.length,(n+1)*this.residuals.length)),this.worst=t.worst(s>.5?Math.min(n+1,t.time.length-1):n)}draw(){if(!this.dirty||!this.width)return!1;if(this.dirty=!1,this.read(),this.followed!==""){let s=this.middle();if(this.anchor&&Number.isFinite(s.x)){let r=s.clone().sub(this.anchor);this.camera.position.add(r),this.controls.target.add(r),this.camera.updateMatrixWorld()}Number.isFinite(s.x)&&(this.anchor=s)}let t=this.camera.position.distanceTo(this.controls.target);this.camera.near=t/200,this.camera.far=t*4+12*this.extent,this.camera.updateProjectionMatrix(),this.camera.updateMatrixWorld();let e=2*Math.tan(this.camera.fov*Math.PI/360)*t/this.height;this.metres=e,this.scales=this.run.said.scales.map(s=>this.layers.larger?s:1);let n=e/t;return this.sea?.update(this.clock.t,this.controls.target,t),this.bodies.update(this.positions,this.quaternions,this.scales,this.present,this.camera,n),this.drawGoals(e),this.drawLines(e,n),this.readFlow()&&this.drawFlow(),this.arrows.forEach((s,r)=>{s.finish(this.width,this.height),s.mesh.visible=this.layers[`flow${r}`]}),this.renderer.render(this.scene,this.camera),this.writeLabels(),!0}drawGoals(t){let{run:e,balls:n}=this;if(n.visible=this.layers.goals&&e.agents<=ew,!n.visible)return;let s=new Re,r=t*nw*Math.min(1,Math.sqrt(60/e.agents));for(let o=0;o<e.agents;o++){let a=this.present[o]&&!Number.isNaN(this.goals[3*o])?r*(o===this.lit?1.6:1):0;s.makeScale(a,a,a).setPosition(this.goals[3*o]||0,this.goals[3*o+1]||0,this.goals[3*o+2]||0),n.setMatrixAt(o,s)}n.instanceMatrix.needsUpdate=!0}drawLines(t,e){let{run:n,lines:s,positions:r,goals:o,theme:a,layers:c}=this;s.clear();let l=n.agents<=bc;c.trails&&this.drawTrails(l?2:1.2);let h=new jt;if(c.links&&n.said.edges.forEach(({tail:d,head:f,kind:g,numbers:x,directed:m},p)=>{let w=this.residuals[p];if(Number.isNaN(w))return;let E=fo(w),v=this.share(w);E?h.copy(a.quiet):h.copy(a.low).lerp(a.high,v);let C=d===this.lit||f===this.lit,A=l?.55:g==="sensing"?.06:.16,D=C?1:E?.5*A:A*(1+.7*v),U=((C?3:l?1.6:.7)+(E?0:v*(l?1.2:.6)))*(.55+.15*Math.min(x,3));if(s.add(r[3*d],r[3*d+1],r[3*d+2],r[3*f],r[3*f+1],r[3*f+2],h,D,U,g==="sensing"?7:E?2.5:0),!m||g==="sensing")return;let S=P=>[0,1,2].map(O=>r[3*d+O]+P*(r[3*f+O]-r[3*d+O])),b=Math.hypot(...S(1).map((P,O)=>P-S(0)[O]));s.add(...S(Math.max(jm-Fu[0]*t/Math.max(b,1e-9),.35)),...S(jm),h,D,l?Fu[1]:.5*Fu[1],0,D,0)}),c.goals)for(let d=0;d<n.agents;d++)this.present[d]&&s.add(r[3*d],r[3*d+1],r[3*d+2],o[3*d],o[3*d+1],o[3*d+2],this.bodies.colours[d],.9,d===this.lit?3:l?1.6:.8,3);if(this.ghosts.draw(this.clock.t,this.scales,this.camera,e,s,r,c.ghosts,a.ink),this.obstacles.draw(this.clock.t,s,r,a.kept,this.lit,c.safety,t),c.stems&&this.floor!==null)for(let d=0;d<n.vehicles;d++)Math.abs(r[3*d+2]-this.floor)>12*t&&s.add(r[3*d],r[3*d+1],r[3*d+2],r[3*d],r[3*d+1],this.floor,a.ink,l?.3:.1,1);let u=n.said.flow.findIndex(({vehicles:d})=>d.includes(this.lit));if(this.lit<n.agents&&c[`flow${u}`]){let d=n.at("flow",this.clock.t,new Float32Array(3),3*this.lit,3),f=n.said.flow[u];Qm(s,r.subarray(3*this.lit,3*this.lit+3),d,f,a.flow[f.scale],1,3)}s.finish(this.width,this.height)}drawTrails(t){let{run:e,clock:n,lines:s}=this,r=e.said.live?e.said.trail:Math.min(e.said.trail,e.end-e.start);if(!(r>0))return;let o=r/this.trailPieces,a=Math.max(n.t-r,e.start),c=[];for(let d=Math.floor(a/o)+1;d*o<n.t;d++)c.push(d*o);let l=this.joints,h=new Map(l.map(d=>[d.t,d]));this.joints=c.map(d=>h.get(d)??{t:d,at:e.at("position",d,new Float32Array(e.vehicles*3))});let u={t:a,at:e.at("position",a,new Float32Array(e.vehicles*3))};for(let d of[...this.joints,{t:n.t,at:this.positions}]){let f=.75*Math.max(0,1-(n.t-u.t)/r),g=.75*Math.max(0,1-(n.t-d.t)/r);for(let x=0;x<e.vehicles;x++){let m=x<e.agents&&!this.present[x]?this.theme.quiet:this.bodies.colours[x],[p,w]=[u.at,d.at];s.add(p[3*x],p[3*x+1],p[3*x+2],w[3*x],w[3*x+1],w[3*x+2],m,f,x===this.lit?t+1.5:t,0,g)}u=d}}readFlow(){let t=this.run.said.flow.map(n=>n.changes.findLast(({time:s})=>s<=this.clock.t+1e-9)??n),e=this.flowsNow?.every((n,s)=>n===t[s]);return this.flowsNow=t,!e}drawFlow(){this.run.said.flow.forEach((t,e)=>{this.arrows[e].clear();let{velocity:n}=this.flowsNow[e];t.places.forEach((s,r)=>Qm(this.arrows[e],s,n[r],t,this.theme.flow[t.scale],.65,1.6))})}largerInWords(){let{larger:t}=this.run.said;return!this.layers.larger||!t.length?"vehicles in their true size":`drawn larger: ${t.map(([e,n])=>`${n.slice(0,bc).join(", ")} \xD7${e}`).join("; ")}`}makeLabels(){let{run:t}=this,e=t.agents<=bc;this.tags=new Map;let n=s=>{let r=document.createElement("bdi");r.textContent=t.names[s],r.className=s<t.agents?"agent":"target",r.style.setProperty("--own",t.said.groups[t.groupOf[s]].colour),this.labels.append(r),this.tags.set(s,r)};for(let s=e?0:t.agents;s<Math.min(t.vehicles,t.agents+bc);s++)n(s);this.extra=e?null:n,this.ring=document.createElement("div"),this.ring.className="ring",this.labels.append(this.ring),this.gridTags=[],this.labelGrid()}labelGrid(){let{run:t}=this;for(let{tag:n}of this.gridTags)n.remove();this.gridTags=[];let e=ad(Math.max(this.box.max.x-this.box.min.x,this.box.max.y-this.box.min.y,.001)/4);this.gridStep=e;for(let n of["x","y"]){let[s,r]=[this.box.min[n],this.box.max[n]];for(let o=Math.ceil(s/e);o<=Math.floor(r/e);o++){let a=document.createElement("span");a.className="grid";let c=o===Math.floor(r/e);a.textContent=`${c?n+" ":""}${ow(o*e+t.said.origin["xy".indexOf(n)],e)}${c?" m":""}`;let l=n==="x"?[o*e,this.box.min.y,this.floor]:[this.box.max.x,o*e,this.floor];this.labels.append(a),this.gridTags.push({tag:a,at:new H(...l)})}}this.surface.material.uniforms.step.value=e}writeLabels(){let{run:t,screen:e}=this,n=new H;for(let o=0;o<t.vehicles;o++){n.fromArray(this.positions,3*o).project(this.camera);let a=n.z<1&&Math.abs(n.x)<1.2&&Math.abs(n.y)<1.2;e[2*o]=a?(n.x+1)/2*this.width:NaN,e[2*o+1]=a?(1-n.y)/2*this.height:NaN}if(this.extra)for(let o of[this.lit,this.worst])o>=0&&!this.tags.has(o)&&this.extra(o);let s=[],r=[...this.tags.keys()].sort((o,a)=>(a===this.lit)-(o===this.lit));for(let o of r){let a=this.tags.get(o),[c,l]=[e[2*o],e[2*o+1]],h=this.layers.names&&!Number.isNaN(c)&&(!this.extra||o>=t.agents||o===this.lit||o===this.worst);if(a.hidden=!h,!h)continue;a.wide??=a.offsetWidth+2;let u=[[9,-20],[9,6],[-9-a.wide,-20],[-9-a.wide,6]],d=([E,v])=>!s.some(([C,A,D])=>c+E<C+D&&C<c+E+a.wide&&Math.abs(l+v-A)<15),f=[a.at??0,0,1,2,3],g=f.find(E=>d(u[E]));if(a.hidden=g===void 0&&o!==this.lit&&o<t.agents,a.hidden)continue;a.at=g??f[0];let[x,m]=u[a.at];s.push([c+x,l+m,a.wide]);let p=`translate(${(c+x).toFixed(1)}px, ${(l+m).toFixed(1)}px)`;a.transform!==p&&(a.style.transform=a.transform=p);let w=`${o<t.agents?"agent":"target"}${o===this.lit?" lit":""}${o<t.agents&&!this.present[o]?" lost":""}`;a.className!==w&&(a.className=w)}this.ring.hidden=this.lit<0||Number.isNaN(e[2*this.lit]),this.ring.hidden||(this.ring.style.transform=`translate(${e[2*this.lit]}px, ${e[2*this.lit+1]}px)`);for(let{tag:o,at:a}of this.gridTags)n.copy(a).project(this.camera),o.hidden=n.z>1||Math.abs(n.x)>1||Math.abs(n.y)>1,o.hidden||(o.style.transform=`translate(${((n.x+1)/2*this.width).toFixed(1)}px, ${((1-n.y)/2*this.height).toFixed(1)}px) translate(-50%, -50%)`)}at(t,e){let n=-1,s=sw;for(let r=0;r<this.run.vehicles;r++){let o=Math.hypot(this.screen[2*r]-t,this.screen[2*r+1]-e);o<s&&([n,s]=[r,o])}return n}pointing(){let t=null,e=s=>{let{left:r,top:o}=this.canvas.getBoundingClientRect();return[s.clientX-r,s.clientY-o]},n=(s,r)=>this.dispatchEvent(new CustomEvent(s,{detail:r}));this.canvas.addEventListener("pointermove",s=>{s.buttons||n("point",this.at(...e(s)))}),this.canvas.addEventListener("pointerleave",()=>n("point",-1)),this.canvas.addEventListener("pointerdown",s=>t=e(s)),this.canvas.addEventListener("pointerup",s=>{let r=e(s);t&&Math.hypot(r[0]-t[0],r[1]-t[1])<6&&n("choose",this.at(...r))}),this.canvas.addEventListener("dblclick",s=>n("follow",this.at(...e(s))))}};function rw(){let i=document.createElement("canvas").getContext("webgl2"),t=i?.getExtension("WEBGL_debug_renderer_info"),e=t?i.getParameter(t.UNMASKED_RENDERER_WEBGL):"";return i?.getExtension("WEBGL_lose_context")?.loseContext(),/swiftshader|llvmpipe|software|basic render/i.test(e)}function ow(i,t){return String(+i.toFixed(Math.max(0,-Math.floor(Math.log10(t))))).replace("-","\u2212")}function Qm(i,t,e,n,s,r,o){let a=Math.hypot(e[0],e[1],e[2]);if(!(a>QS*n.top))return;let c=Math.min(a/n.top,1),l=s[Math.round(c*(s.length-1))],h=.95*c*n.spacing,[u,d,f]=[e[0]/a*h,e[1]/a*h,e[2]/a*h],[g,x,m]=[t[0]-u/2,t[1]-d/2,t[2]-f/2],[p,w,E]=[g+u,x+d,m+f];i.add(g,x,m,p,w,E,l,.5*r,o,0,r);for(let v of[1,-1])i.add(p,w,E,p-.3*u-v*.16*d,w-.3*d+v*.16*u,E-.3*f,l,r,o)}function aw(i){let t=i.map(e=>new jt(e));return Array.from({length:33},(e,n)=>{let s=n/32*(t.length-1),r=Math.min(Math.floor(s),t.length-2);return t[r].clone().lerp(t[r+1],s-r)})}function tg(i){let t=[],{residual:e}=i.series;for(let s=0;s<e.length;s+=Math.max(1,Math.floor(e.length/2e4))){let r=Math.abs(e[s]);Number.isFinite(r)&&t.push(r)}t.sort((s,r)=>s-r);let n=t[Math.floor(.95*(t.length-1))]||1;return[Math.max(t[Math.floor(.05*(t.length-1))]||0,n/100),Math.max(n,1e-9)].map(Number)}function eg({run:i,extent:t,box:e,floor:n}){let s=e.getCenter(new H),r=2.2*t,o=new on({uniforms:{colour:{value:new jt},grid:{value:new jt},sky:{value:new jt},step:{value:1},centre:{value:s},radius:{value:r},clear:{value:i.said.surface==="ground"?.96:.72}},vertexShader:"varying vec2 place; void main() { vec4 p = modelMatrix * vec4(position, 1.0); place = p.xy; gl_Position = projectionMatrix * viewMatrix * p; }",fragmentShader:`
      uniform vec3 colour, grid, sky, centre; uniform float step, radius, clear; varying vec2 place;
      void main() {
        vec2 cell = place / step;
        vec2 away = abs(fract(cell - 0.5) - 0.5) / max(fwidth(cell), vec2(1e-6));
        float line = 1.0 - min(min(away.x, away.y), 1.0);
        float fade = 1.0 - smoothstep(0.25, 1.0, length(place - centre.xy) / radius);
        vec3 c = mix(colour, grid, 0.45 * line * fade);
        gl_FragColor = vec4(mix(sky, c, fade), clear * smoothstep(0.0, 0.3, fade));
        #include <colorspace_fragment>
      }`,transparent:!0,depthWrite:!1,side:Vn}),a=new tn(new Xo(r,48),o);return a.position.set(s.x,s.y,n),a.renderOrder=-1,a}var We=i=>document.getElementById(i),lw=[["space","play or pause"],["\u2190 \u2192","a sample back or on; with shift a second"],["Home End","start or end"],[", .","slower or faster"],["1 2 3","at an angle, from above, from the side"],["F","follow who is lit, or nobody"],["N P","light up the next or previous agent"],["W","light up who is farthest off now"],["L","loop"],["T","light or dark"],["in the scene","arrows turn, shift and arrows move, + and \u2212 zoom; drag turns, right drag moves, wheel zooms; a click lights up, a double click follows"],["in the curves","point at a line to light up its agent, click or drag to go to a time"]],cw={links:"links",goals:"where agents should be",trails:"trails",names:"names",stems:"heights",larger:"vehicles larger than life",ghosts:"other runs",safety:"whom the filter keeps apart"};async function hw(){let i=await rd(),t=i.said.live?new ua(i):new gr(i),e={lit:-1,chosen:-1},n=null,s=null;try{n=new Sc(i,t,We("scene"),We("labels"))}catch(E){We("nothing").hidden=!1,We("nothing").textContent=`This browser cannot draw in three dimensions (${E.message}); the curves and facts work.`}let r=new Ra(i,t,We("curves")),o=new ha(i,E=>u(E)),a=E=>{e.lit=E>=0?E:e.chosen,r.light(e.lit),n&&n.lit!==e.lit&&(n.lit=e.lit,n.changed()),l()},c=E=>{e.chosen=E===e.chosen?-1:E,s?.choose(E),a(e.chosen)},l=()=>o.show(t.t,e.lit,i.worst(i.locate(t.t)[0])),h=(E,v=-1)=>{t.pause(),t.seek(E),e.chosen=v,a(v),window.scrollTo({top:0})},u=(E,v=!0)=>{let C=E===-1||E===void 0?"":E;We("follow").value=String(C),Number.isInteger(C)&&(e.chosen=C,a(C)),n?.follow(C,v)};i.said.live?po(i):md(i,h),_d(i,h),n&&gd(i,n);let d=fw(i,t);pw(i,n,u),mw(n,r),gw(i,t,n,e,{choose:c,follow:u,controls:d}),t.addEventListener("time",()=>{n?.changed(),l()}),n&&(n.addEventListener("point",({detail:E})=>a(E)),n.addEventListener("choose",({detail:E})=>c(E)),n.addEventListener("follow",({detail:E})=>E>=0&&u(E))),r.addEventListener("point",({detail:E})=>a(E)),await new Promise(requestAnimationFrame);let f=id();f.speed>0&&t.setSpeed(+f.speed),t.seek(Number.isFinite(+f.t)&&f.t!==void 0?+f.t:i.start),f.lit!==void 0&&i.names.includes(f.lit)&&c(i.names.indexOf(f.lit)),f.follow!==void 0&&u(f.follow==="team"?"team":i.names.indexOf(f.follow),!1),l(),n&&f.cam?n.place=f.cam:n&&f.follow===void 0&&n.view("angle"),i.said.live&&(s=vd(i,t,n,r,d),t.catchUp()),d.show(),l();let[g,x,m]=[performance.now(),0,""],p=0,w=E=>{if(t.advance(Math.min((E-g)/1e3,2)),g=E,n?.draw()){x++;let v=n.largerInWords();v!==m&&(n.larger.textContent=m=v),uw(n)}E-p>400&&!t.playing&&(p=E,dw(i,t,n,e)),requestAnimationFrame(w)};requestAnimationFrame(w),window.mjsheaf={run:i,clock:t,world:n,curves:r,state:e,get frames(){return x}},document.documentElement.dataset.ready="yes"}function uw(i){let t=10**Math.floor(Math.log10(i.metres*160)),e=[5,2,1].map(r=>r*t).find(r=>r<=i.metres*160),n=We("scale"),s=e>=1e4?`${e/1e3} km`:`${Yt(e).replace(/\.0+$/,"")} m`;n.firstElementChild.textContent!==s&&(n.firstElementChild.textContent=s),n.lastElementChild.style.width=`${(e/i.metres).toFixed(1)}px`}var Ou="";function dw(i,t,e,n){let s={t:t.t.toFixed(3).replace(/\.?0+$/,"")||"0"};e&&(s.cam=e.place),e&&e.followed!==""&&(s.follow=e.followed==="team"?"team":i.names[e.followed]),n.chosen>=0&&(s.lit=i.names[n.chosen]);let r=JSON.stringify(s);Ou&&r!==Ou&&sd(s),Ou=r}function fw(i,t){let[e,n,s,r,o]=["play","slider","time","speed","loop"].map(We),a=()=>i.said.live?.end??i.end;Object.assign(n,{min:i.start,max:a()});let c=f=>Object.assign(document.createElement("option"),{value:f,textContent:Number.isFinite(f)?`${f}\xD7`:"as fast as possible"});for(let f of t.speeds)r.append(c(f));o.hidden=!!i.said.live;let l=()=>{let f=i.events.map(g=>{let x=st("i");return x.style.left=`${100*(g.time-i.start)/(a()-i.start||1)}%`,x.title=g.events.join(", "),x});We("marks").replaceChildren(...f)};l();let h=null,u=()=>{n.value=t.t;let f=`${t.t.toFixed(2)} s`;s.textContent=`${f} of ${+a().toFixed(3)} s`,n.setAttribute("aria-valuetext",f);let g=[...i.events].reverse().find(p=>p.time<=t.t),x=Math.max(Math.min(2*t.speed,i.end),.06*(i.end-i.start)),m=g&&t.t-g.time<x?`${g.events.join(", ")} (${Yt(g.time)} s)`:"";m!==h&&(We("event").replaceChildren(st("bdi","",m)),We("event").classList.toggle("seen",m!==""),h=m)},d=()=>{e.textContent=t.playing?"\u275A\u275A":"\u25B6",e.setAttribute("aria-label",t.playing?"Pause":"Play"),[...r.options].some(f=>+f.value===t.speed)||r.append(c(t.speed)),r.value=String(t.speed),o.setAttribute("aria-pressed",String(t.loop))};return t.addEventListener("time",u),t.addEventListener("state",d),e.addEventListener("click",()=>t.toggle()),n.addEventListener("input",()=>{t.pause(),t.seek(+n.value)}),r.addEventListener("change",()=>t.setSpeed(+r.value)),o.addEventListener("click",()=>t.setLoop(!t.loop)),d(),{show:u,mark:l}}function pw(i,t,e){let n=We("follow"),s=(o,a)=>n.append(Object.assign(document.createElement("option"),{value:o,textContent:a}));if(s("team","the team"),i.names.forEach((o,a)=>s(String(a),o)),n.addEventListener("change",()=>e(n.value===""||n.value==="team"?n.value:+n.value)),!t){We("views").hidden=!0;return}for(let o of document.querySelectorAll("#views [data-view]"))o.addEventListener("click",()=>{e(""),t.view(o.dataset.view)});let r=i.said.flow.map(({name:o},a)=>[`flow${a}`,`arrows of the ${o}`]);for(let[o,a]of[...Object.entries(cw),...r]){if(o==="ghosts"&&!i.said.ghosts.length||o==="safety"&&!i.series.cause)continue;let c=Object.assign(document.createElement("input"),{type:"checkbox",checked:t.layers[o]});c.addEventListener("change",()=>{t.layers[o]=c.checked,t.changed()}),We("layers").lastElementChild.append(st("label","",c,a))}}function mw(i,t){let e=window.matchMedia("(prefers-color-scheme: dark)"),n=s=>{document.documentElement.dataset.theme=s,i?.setTheme(s),t.redraw()};n(e.matches?"dark":"light"),e.addEventListener("change",()=>n(e.matches?"dark":"light")),We("theme").addEventListener("click",()=>n(document.documentElement.dataset.theme==="dark"?"light":"dark"))}function gw(i,t,e,n,{choose:s,follow:r}){let o=st("dl");for(let[u,d]of lw)o.append(st("dt","",u),st("dd","",d));We("keys").append(o);let a=u=>{We("keys").hidden=!u,We("help").setAttribute("aria-expanded",String(u))};We("help").addEventListener("click",()=>a(We("keys").hidden));let c=u=>{n.chosen=n.chosen<0?u>0?0:i.vehicles-1:(n.chosen+u+i.vehicles)%i.vehicles;let d=n.chosen;n.chosen=-1,s(d)},l={ArrowLeft:u=>u?e.pan(-.05,0):e.turn(-6,0),ArrowRight:u=>u?e.pan(.05,0):e.turn(6,0),ArrowUp:u=>u?e.pan(0,.05):e.turn(0,5),ArrowDown:u=>u?e.pan(0,-.05):e.turn(0,-5),"+":()=>e.zoom(.87),"=":()=>e.zoom(.87),"-":()=>e.zoom(1.15)},h={" ":()=>t.toggle(),ArrowLeft:u=>u?t.seek(t.t-1):t.step(-1),ArrowRight:u=>u?t.seek(t.t+1):t.step(1),Home:()=>t.seek(i.start),End:()=>t.seek(i.end),",":()=>t.change(-1),".":()=>t.change(1),1:()=>e?.view("angle"),2:()=>e?.view("above"),3:()=>e?.view("side"),f:()=>r(e?.followed!==""?"":n.lit>=0?n.lit:i.worst(i.locate(t.t)[0])),n:()=>c(1),p:()=>c(-1),w:()=>s(i.worst(i.locate(t.t)[0])),l:()=>t.setLoop(!t.loop),t:()=>We("theme").click(),"?":()=>a(We("keys").hidden),Escape:()=>(a(!1),s(-1))};document.addEventListener("keydown",u=>{if(u.ctrlKey||u.metaKey||u.altKey)return;let{target:d,key:f,shiftKey:g}=u;if(d.matches("select")||d.matches("button, summary, input[type=checkbox]")&&(f===" "||f==="Enter"))return;let x=d===We("scene")&&e&&l[f]||h[f]||h[f.toLowerCase()];x&&(u.preventDefault(),x(g))})}hw().catch(i=>{throw We("nothing").hidden=!1,We("nothing").textContent=`The page cannot be shown: ${i.message}`,i});})();
